// The set of all policies' rewards in the 7x7 world, with the asked direction and where it leads.

import { svg } from "./knob.js";

const EDGE = { left: 40, right: 14, top: 14, bottom: 40 };
const SCALE = 42; // units of the picture for a reward of 1, the same on both axes

export class Front {
  /**
   * @param {SVGElement} root Element that is filled.
   * @param {{polygon: number[][], front: number[][]}} world Of `page.crossing`.
   */
  constructor(root, { polygon, front }) {
    this.root = root;
    const [envs, socials] = [0, 1].map((axis) => polygon.map((point) => point[axis]));
    this.low = [Math.floor(Math.min(...envs)), Math.floor(Math.min(...socials))];
    this.high = [Math.ceil(Math.max(...envs)), Math.ceil(Math.max(...socials))];
    this.width = EDGE.left + EDGE.right + SCALE * (this.high[0] - this.low[0]);
    this.height = EDGE.top + EDGE.bottom + SCALE * (this.high[1] - this.low[1]);
    root.setAttribute("viewBox", `0 0 ${this.width} ${this.height}`);
    root.append(svg("polygon", { points: this.path(polygon), class: "attainable" }));
    this.axes();
    root.append(svg("polyline", { points: this.path(front), class: "front" }));
    for (const point of front) {
      const [cx, cy] = this.place(...point);
      root.append(svg("circle", { cx, cy, r: 3.4, class: "front-corner" }));
    }
    this.marks = svg("g", {});
    root.append(this.marks);
  }

  place(env, social) {
    return [EDGE.left + SCALE * (env - this.low[0]), EDGE.top + SCALE * (this.high[1] - social)];
  }

  path(points) {
    return points.map((point) => this.place(...point).join(",")).join(" ");
  }

  axes() {
    const { root, low, high } = this;
    const text = (value) => String(value).replace("-", "−");
    for (let value = low[0]; value <= high[0]; value += 1) {
      const [x, bottom] = this.place(value, low[1]);
      root.append(svg("line", { x1: x, x2: x, y1: EDGE.top, y2: bottom, class: value === 0 ? "axis-zero" : "axis-line" }));
      if (value % 2 === 0) root.append(svg("text", { x, y: bottom + 15, class: "axis-number middle" }, text(value)));
    }
    for (let value = low[1]; value <= high[1]; value += 1) {
      const [left, y] = this.place(low[0], value);
      const [right] = this.place(high[0], value);
      root.append(svg("line", { x1: left, x2: right, y1: y, y2: y, class: value === 0 ? "axis-zero" : "axis-line" }));
      if (value % 2 === 0) root.append(svg("text", { x: left - 6, y: y + 4, class: "axis-number right" }, text(value)));
    }
    root.append(svg("text", { x: this.width / 2, y: this.height - 6, class: "axis-title middle" }, "own progress in an episode"));
    root.append(svg("text", { x: 0, y: 0, transform: `translate(13 ${this.height / 2 - 12}) rotate(-90)`, class: "axis-title middle" }, "effect on others"));
  }

  /** Show an asked angle, the corner that is best there, and the furthest point at the angle. */
  show(asked, corner, radius) {
    const radians = (asked * Math.PI) / 180;
    const [env, social] = [Math.cos(radians), Math.sin(radians)];
    const [x0, y0] = this.place(0, 0);
    const [x, y] = this.place(...corner.point);
    const line = (from, to, kind) => svg("line", { x1: from[0], y1: from[1], x2: to[0], y2: to[1], class: kind });
    const reach = Math.min(env > 0 ? this.high[0] / env : Infinity, social > 0 ? this.high[1] / social : Infinity);
    const along = 1.9 * SCALE;
    const marks = [
      line([x0, y0], this.place(reach * env, reach * social), "asked"),
      line([x - along * social, y - along * env], [x + along * social, y + along * env], "touching"),
      line([x0, y0], [x, y], "lies"),
    ];
    if (radius !== null) {
      const [cx, cy] = this.place(radius * env, radius * social);
      marks.push(svg("circle", { cx, cy, r: 6, class: "mixed" }));
    }
    marks.push(svg("circle", { cx: x, cy: y, r: 8, class: "lies-point" }));
    const [wordX, wordY] = this.place(1.1 * env, 1.1 * social);
    marks.push(svg("text", { x: wordX - 8, y: wordY - 6, class: "asked-word right" }, `asked ${asked}°`));
    marks.push(svg("text", { x: Math.max(x + 34, 130), y: y + 27, class: "lies-word right" }, `lies at ${corner.angle.toFixed(0)}°`.replace("-", "−")));
    this.marks.replaceChildren(...marks);
  }
}
