// The trade-off curve: what the dial earns for itself and for the others at each angle.

import { signed } from "./bars.js";
import { svg } from "./knob.js";

const BOX = { left: 58, right: 14, top: 16, bottom: 46, width: 460, height: 330 };

export class Curve {
  /**
   * @param {SVGElement} root Element that is filled.
   * @param {{asked: number, env: number[], social: number[]}[]} points Means with their intervals.
   */
  constructor(root, points) {
    this.root = root;
    this.points = points;
    this.marks = svg("g", {});
    root.setAttribute("viewBox", `0 0 ${BOX.width} ${BOX.height}`);
    this.range = { env: nice(points.map((one) => one.env[0])), social: nice(points.map((one) => one.social[0])) };
    this.drawAxes();
    root.append(svg("polyline", { points: points.map((one) => this.place(one.env[0], one.social[0])).join(" "), class: "curve-line" }));
    for (const { asked, env, social } of points) {
      const [cx, cy] = this.place(env[0], social[0]);
      root.append(svg("circle", { cx, cy, r: 2.6, class: "curve-point" }));
      if (asked % 30 === 0) root.append(svg("text", { x: cx + 14, y: cy + (asked > 60 ? -8 : 4), class: "axis-number left" }, `${asked}°`));
    }
    root.append(this.marks);
  }

  place(env, social) {
    const { env: across, social: up } = this.range;
    const width = BOX.width - BOX.left - BOX.right;
    const height = BOX.height - BOX.top - BOX.bottom;
    const x = BOX.left + ((env - across.low) / (across.high - across.low)) * width;
    const y = BOX.top + (1 - (social - up.low) / (up.high - up.low)) * height;
    const inside = (value, low, high) => Math.min(Math.max(value, low), high);
    return [inside(x, BOX.left, BOX.width - BOX.right), inside(y, BOX.top, BOX.height - BOX.bottom)];
  }

  drawAxes() {
    const { env, social } = this.range;
    const bottom = BOX.height - BOX.bottom;
    for (const value of env.ticks) {
      const [x] = this.place(value, social.low);
      this.root.append(svg("line", { x1: x, x2: x, y1: BOX.top, y2: bottom, class: "axis-line" }));
      this.root.append(svg("text", { x, y: bottom + 16, class: "axis-number middle" }, tidy(value)));
    }
    for (const value of social.ticks) {
      const [, y] = this.place(env.low, value);
      this.root.append(svg("line", { x1: BOX.left, x2: BOX.width - BOX.right, y1: y, y2: y, class: "axis-line" }));
      this.root.append(svg("text", { x: BOX.left - 8, y: y + 4, class: "axis-number right" }, tidy(value)));
    }
    const middle = (BOX.top + bottom) / 2;
    this.root.append(svg("text", { x: (BOX.left + BOX.width - BOX.right) / 2, y: BOX.height - 8, class: "axis-title middle" }, "own progress, mean of an episode"));
    this.root.append(svg("text", { x: 0, y: 0, transform: `translate(14 ${middle}) rotate(-90)`, class: "axis-title middle" }, "effect on others"));
  }

  /** Return the curve's point at an angle, on the straight line between its neighbours. */
  at(angle) {
    const after = this.points.findIndex((one) => one.asked >= angle);
    const [low, high] = [this.points[Math.max(after - 1, 0)], this.points[after]];
    const share = high.asked > low.asked ? (angle - low.asked) / (high.asked - low.asked) : 0;
    const mix = (name) => low[name][0] + share * (high[name][0] - low[name][0]);
    return { env: mix("env"), social: mix("social") };
  }

  /** Show the twins' places, and what was measured at them, each `{ env, social }` with intervals. */
  show(twins, measured) {
    this.marks.replaceChildren();
    twins.forEach((twin, number) => {
      const found = measured[number];
      if (found) this.measurement(twin, found);
      const { env, social } = found ? { env: found.env[0], social: found.social[0] } : this.at(twin.angle);
      const [cx, cy] = this.place(env, social);
      const mark = svg("g", { class: `curve-mark twin-${twin.place}` });
      mark.append(svg("circle", { cx, cy, r: 11 }), svg("text", { x: cx, y: cy + (twin.letter.length > 1 ? 3 : 4.2), class: twin.letter.length > 1 ? "wide" : "" }, twin.letter));
      const angle = twin.angle === undefined ? "" : `, ${twin.angle}°`;
      mark.append(svg("title", {}, `${twin.letter}${angle}: own progress ${signed(env)}, effect on others ${signed(social)}`));
      if (env < this.range.env.low || env > this.range.env.high || social < this.range.social.low || social > this.range.social.high) {
        const side = cx > BOX.width / 2 ? "right" : "";
        mark.append(svg("text", { x: cx + (side ? -16 : 16), y: cy + 4, class: `beyond ${side}` }, `beyond: ${signed(env)}, ${signed(social)}`));
      }
      this.marks.append(mark);
    });
  }

  measurement({ place }, { env, social }) {
    const [left] = this.place(env[1], social[0]);
    const [right, y] = this.place(env[2], social[0]);
    const [x, low] = this.place(env[0], social[1]);
    const [, high] = this.place(env[0], social[2]);
    this.marks.append(svg("path", { d: `M${left} ${y}H${right}M${x} ${low}V${high}`, class: `curve-interval twin-${place}` }));
  }
}

function tidy(value) {
  return String(Number(value.toFixed(2))).replace("-", "−");
}

/** Return an interval around values with round ticks. */
function nice(values) {
  const [least, most] = [Math.min(...values), Math.max(...values)];
  const rough = (most - least) / 4 || 1;
  const unit = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].find((factor) => factor * unit >= rough) * unit;
  const low = Math.floor((least - 0.15 * step) / step) * step;
  const high = Math.ceil((most + 0.15 * step) / step) * step;
  const ticks = [];
  for (let value = low; value <= high + step / 2; value += step) ticks.push(value);
  return { low, high, ticks };
}
