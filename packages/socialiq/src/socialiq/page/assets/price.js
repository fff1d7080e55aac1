// What an angle costs the others: metres that they lose, by angle, for two rewards; drawn point by point.

import { svg } from "./knob.js";

const BOX = { left: 76, right: 24, top: 18, bottom: 46, width: 720, height: 330 };
const EVERY = 250; // ms from one angle to the next

export class Price {
  /**
   * @param {SVGElement} root Element that is filled.
   * @param {{name: string, place: number, points: object[]}[]} lines Points `{ angle, delay: [mean, low, high], kept }`.
   */
  constructor(root, lines) {
    Object.assign(this, { root, lines });
    const all = lines.flatMap(({ points }) => points);
    this.most = Math.ceil(Math.max(...all.map(({ delay }) => delay[2])) / 10) * 10;
    root.setAttribute("viewBox", `0 0 ${BOX.width} ${BOX.height}`);
    this.axes();
    this.count = Math.max(...lines.map(({ points }) => points.length));
    this.drawn = lines.map(({ name, place, points }) => {
      const line = svg("polyline", { class: `price-line twin-${place}` });
      const end = svg("text", { class: `price-name twin-${place}` }, name);
      const marks = points.map(({ angle, delay: [mean, low, high] }) => {
        const [x, y] = this.place(angle, mean);
        const mark = svg("g", { class: `price-point twin-${place}` });
        mark.append(svg("path", { d: `M${x} ${this.place(angle, low)[1]}V${this.place(angle, high)[1]}` }), svg("circle", { cx: x, cy: y, r: 4 }), svg("title", {}, `${name}, ${angle}°: others lose ${mean.toFixed(1)} m`));
        return mark;
      });
      root.append(line, ...marks, end);
      return { line, end, marks, points };
    });
    this.upTo(this.count);
  }

  /** What the chart says, from its figures. */
  get words() {
    const [caused, near] = this.lines.map(({ points }) => points);
    const metres = ({ delay }) => `${delay[0].toFixed(0)} m`;
    const last = caused.length - 1;
    const middle = caused.findIndex(({ angle }) => angle === 45);
    const own = (point) => `${Math.round(100 * (1 - point.kept))} %`;
    return `Metres that all others together lose in 30 s because this car is there. Told to count what it causes, the car costs them ${metres(caused[0])} at 0°, ${metres(caused[middle])} at 45° and ${metres(caused[last])} at 90°, and gives up ${own(caused[middle])} and ${own(caused[last])} of its own progress. Told to count what happens near it: ${metres(near[0])}, ${metres(near[middle])} and ${metres(near[last])}.`;
  }

  place(angle, metres) {
    const width = BOX.width - BOX.left - BOX.right;
    const height = BOX.height - BOX.top - BOX.bottom;
    return [BOX.left + (angle / 90) * width, BOX.top + (1 - metres / this.most) * height];
  }

  axes() {
    const [right, bottom] = this.place(90, 0);
    for (let metres = 0; metres <= this.most; metres += 10) {
      const [, y] = this.place(0, metres);
      this.root.append(svg("line", { x1: BOX.left, x2: right, y1: y, y2: y, class: "axis-line" }), svg("text", { x: BOX.left - 8, y: y + 4, class: "axis-number right" }, `${metres} m`));
    }
    for (let angle = 0; angle <= 90; angle += 15) this.root.append(svg("text", { x: this.place(angle, 0)[0], y: bottom + 18, class: "axis-number middle" }, `${angle}°`));
    this.root.append(svg("text", { x: (BOX.left + right) / 2, y: BOX.height - 6, class: "axis-title middle" }, "angle that the car is told"));
  }

  /** Show the first points of each line. */
  upTo(count) {
    this.drawn.forEach(({ line, end, marks, points }) => {
      const shown = points.slice(0, count);
      line.setAttribute("points", shown.map(({ angle, delay }) => this.place(angle, delay[0])).join(" "));
      marks.forEach((mark, number) => mark.setAttribute("visibility", number < count ? "visible" : "hidden"));
      const [x, y] = this.place(shown[shown.length - 1].angle, shown[shown.length - 1].delay[0]);
      end.setAttribute("x", x);
      end.setAttribute("y", y - 12);
    });
  }

  /** Draw the lines from the first angle on. */
  begin() {
    window.clearInterval(this.timer);
    if (window.matchMedia("(prefers-reduced-motion: reduce)").matches) return;
    let count = 1;
    this.upTo(count);
    this.timer = window.setInterval(() => {
      this.upTo((count += 1));
      if (count >= this.count) window.clearInterval(this.timer);
    }, EVERY);
  }
}
