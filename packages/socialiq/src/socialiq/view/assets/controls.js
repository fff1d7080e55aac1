// The buttons below a scene: play, step, time, speed; and what is shown, kept in the address.

import { Transport } from "../../page/assets/transport.js";

const SPEEDS = ["0.25", "0.5", "1", "2", "4"];

export class Controls {
  /**
   * @param {number} rate Pictures of a second.
   * @param {number} step Pictures of a step.
   * @param {object} state With `step`, the picture shown, and `speed`; changed in place.
   * @param {() => void} changed Called when another picture is to be shown.
   */
  constructor(rate, step, state, changed) {
    Object.assign(this, { step, state, changed });
    this.find = (name) => document.getElementById(name);
    this.clock = new Transport(rate, () => this.show());
    this.clock.time = state.step;
    const { clock } = this;
    const on = (name, event, act) => this.find(name).addEventListener(event, act);
    on("play", "click", () => this.toggle());
    on("back", "click", () => clock.step(-1, step));
    on("step", "click", () => clock.step(1, step));
    on("time", "input", (event) => { clock.playing = false; clock.seek(Number(event.target.value)); });
    on("speed", "change", (event) => { state.speed = Number(event.target.value); this.show(); });
    document.addEventListener("keydown", (event) => {
      if (event.target.closest("input, select, textarea") || event.metaKey || event.ctrlKey || event.altKey) return;
      if (this.key(event)) event.preventDefault();
    });
  }

  toggle() {
    if (this.clock.playing) this.clock.pause();
    else this.clock.play();
  }

  key(event) {
    const acts = { " ": () => this.toggle(), ".": () => this.clock.step(1, this.step), ",": () => this.clock.step(-1, this.step) };
    if (!(event.key in acts) || (event.key === " " && event.target.closest("button, a"))) return false;
    acts[event.key]();
    return true;
  }

  /** Take a film of so many pictures; from its start, and running unless motion is reduced. */
  load(end, rewound) {
    this.clock.load(end);
    this.find("time").max = end;
    if (rewound) this.clock.time = 0;
    const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (rewound && !still) this.clock.play();
    else this.show();
  }

  show() {
    const { clock, state } = this;
    clock.speed = state.speed;
    this.find("speed").value = SPEEDS.includes(String(state.speed)) ? String(state.speed) : "1";
    this.find("time").value = clock.time;
    this.find("clock").textContent = `${(clock.time / clock.rate).toFixed(1)} s`;
    this.find("play").textContent = clock.playing ? "Pause" : clock.time >= clock.end ? "Again" : "Play";
    this.changed();
    if (!clock.playing) this.keep();
  }

  /** Keep everything shown in the address, so that reloading restores it. */
  keep() {
    this.state.step = Math.round(this.clock.time);
    window.clearTimeout(this.keeping);
    const text = Object.entries(this.state).map(([name, value]) => `${name}=${value}`).join("&");
    this.keeping = window.setTimeout(() => window.history.replaceState(null, "", `#${text}`), 150);
  }
}

/**
 * Return the state in the address.
 *
 * @param {Object<string, number[]>} known First value, least, largest and unit (1) of each name.
 */
export function stateOf(known) {
  const given = new URLSearchParams(window.location.hash.replace(/^#/, ""));
  const state = {};
  for (const [name, [first, least, most, unit = 1]] of Object.entries(known)) {
    const value = Number(given.get(name) || NaN);
    state[name] = value >= least && value <= most ? Math.round(value / unit) * unit : first;
  }
  return state;
}
