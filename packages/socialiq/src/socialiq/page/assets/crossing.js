// The third tab: the 7x7 world, where the best policy of every angle is known exactly.

import { keepAddress } from "./address.js";
import { element, signed } from "./bars.js";
import { Front } from "./front.js";
import { Knob, svg } from "./knob.js";

const CELL = 50; // units of the picture
const FULLEST = 0.35; // opacity of the most visited cell, on which its number can be read

export class Crossing {
  /**
   * @param {object} world Of `page.crossing`: corners of the front, and the best one of each angle.
   * @param {object} state Of `address.readAddress`; its `grid` is the asked angle.
   */
  constructor(world, state) {
    Object.assign(this, { world, state });
    this.find = (name) => document.getElementById(`grid-${name}`);
    this.knob = new Knob(this.find("dial"), [0, world.best.length - 1], (angle) => this.turn(angle));
    this.front = new Front(this.find("front"), world);
    this.show();
  }

  turn(angle) {
    this.state.grid = angle;
    this.show();
    keepAddress(this.state);
  }

  /** Arrow keys turn the dial wherever the focus is; return whether one was meant. */
  key(event) {
    if (!event.key.startsWith("Arrow")) return false;
    this.knob.key(event);
    return true;
  }

  show() {
    const { world, state } = this;
    const asked = state.grid;
    const corner = world.corners[world.best[asked]];
    this.knob.show([{ angle: asked, letter: "", place: 1 }], 0);
    this.find("angle").textContent = `${asked}°`;
    this.front.show(asked, corner, world.radius[asked]);
    this.road(corner);
    this.table(corner);
    const [env, social] = corner.point;
    this.find("place").textContent =
      `Asked for ${asked}°, the best policy earns own progress ${signed(env)} and effect on others ${signed(social)}: this lies at ${degrees(corner.angle)}.`;
    this.find("why").textContent = why(asked, corner, world);
  }

  /** Cells with visits, and the ego's moves as arcs. */
  road(corner) {
    const { size } = this.world;
    const root = this.find("road");
    root.replaceChildren();
    const most = Math.max(...corner.decisions.map(total), ...corner.vehicles);
    for (let y = 0; y < size; y += 1) for (let x = 0; x < size; x += 1) this.cell(x, y, corner, most);
    corner.decisions.forEach((taken, x) => taken.forEach((count, speed) => count > 0.005 && root.append(...move(x, speed, count, size))));
    const share = (value) => `${(100 * value).toFixed(0)} %`;
    const words = `arrives in ${share(corner.arrival)} of the episodes, after ${corner.length.toFixed(1)} steps in the mean`;
    root.setAttribute("aria-label", `Cells of the 7x7 crossing: the ego goes east and ${words}; before the conflict it stops ${corner.decisions[this.world.conflict - 1][0].toFixed(1)} times`);
  }

  cell(x, y, corner, most) {
    const { size, conflict } = this.world;
    const root = this.find("road");
    const [left, top] = [x * CELL, (size - 1 - y) * CELL];
    const lane = x === conflict || y === conflict;
    const kind = `cell${lane ? " lane" : ""}${x === conflict && y === conflict ? " conflict" : ""}`;
    root.append(svg("rect", { x: left + 1, y: top + 1, width: CELL - 2, height: CELL - 2, rx: 4, class: kind }));
    const [count, name] = y === conflict ? [total(corner.decisions[x]), "visits"] : [corner.vehicles[y], "vehicles"];
    if (!lane || count < 0.005) return;
    const share = Math.sqrt(count / most);
    root.append(svg("rect", { x: left + 1, y: top + 1, width: CELL - 2, height: CELL - 2, rx: 4, class: name, opacity: FULLEST * (0.3 + 0.7 * share) }));
    root.append(svg("text", { x: left + CELL / 2, y: top + CELL - 7, class: "count" }, count.toFixed(1)));
  }

  table(corner) {
    const names = corner.approaching.map((_, row) => (row < this.world.conflict ? `row ${row}, ${this.world.conflict - row} ${row === this.world.conflict - 1 ? "cell" : "cells"} before it` : "none comes"));
    const rows = corner.approaching.map((taken, row) => [names[row], taken]).filter(([, taken]) => total(taken) > 0.0005);
    const made = rows.map(([name, taken]) => {
      const shares = taken.map((count) => element("td", { textContent: `${((100 * count) / total(taken)).toFixed(0)} %` }));
      return element("tr", {}, element("th", { scope: "row", textContent: name }), element("td", { textContent: total(taken).toFixed(2) }), ...shares);
    });
    this.find("policy").replaceChildren(...made);
  }
}

/** Return why the best policy's rewards don't lie at the asked angle. */
function why(asked, corner, { front, radius }) {
  const radians = (asked * Math.PI) / 180;
  const value = Math.cos(radians) * corner.point[0] + Math.sin(radians) * corner.point[1];
  const parts = [
    "The angle says in which direction to go furthest, not where the rewards lie: the best policy is where the line at right angles to that direction last touches the set of all policies.",
    `The front has ${front.length} such corners; this one is the best from ${degrees(corner.low)} to ${degrees(corner.high)}.`,
  ];
  const held = radius[asked];
  if (held === null) parts.push(`No policy's rewards lie at ${asked}°.`);
  else parts.push(`The furthest policy that does lie at ${asked}° (circle), a random mixture, scores ${held.toFixed(2)} there; this one scores ${value.toFixed(2)}.`);
  return parts.join(" ");
}

function total(counts) {
  return counts.reduce((sum, one) => sum + one, 0);
}

function degrees(angle) {
  return `${angle.toFixed(1)}°`.replace("-", "−");
}

/** Return the arc of a move from a column, or the loop of a stop, with its tip. */
function move(x, speed, count, size) {
  const from = (x + 0.5) * CELL;
  const to = (Math.min(x + speed, size - 1) + 0.5) * CELL;
  const base = (Math.floor(size / 2) + 0.5) * CELL - 4;
  const width = 1.5 + 2.5 * Math.sqrt(Math.min(count, 9));
  const high = speed === 0 ? 0 : 22 + 12 * speed;
  const path = speed === 0 ? `M${from - 8} ${base} C${from - 26} ${base - 44} ${from + 26} ${base - 44} ${from + 8} ${base}` : `M${from + 12} ${base - 2} Q${(from + to) / 2} ${base - high} ${to - 15} ${base - 4}`;
  const tip = speed === 0 ? [from + 8, base + 2, 115] : [to - 11, base, 45];
  const [tipX, tipY, turn] = tip;
  const half = 4 + width / 2;
  return [
    svg("path", { d: path, class: "flow", "stroke-width": width }),
    svg("path", { d: `M${-half * 1.4} ${-half}L0 0L${-half * 1.4} ${half}Z`, transform: `translate(${tipX} ${tipY}) rotate(${turn})`, class: "flow-tip" }),
  ];
}
