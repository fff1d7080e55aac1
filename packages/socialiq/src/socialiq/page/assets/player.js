// Plays one film after another: a picture, a clock, and both rewards by signal.

import { Bars, element } from "./bars.js";
import { decisionAt, outcomeOf, sceneAt, sumsOf } from "./film.js";
import { Stage } from "./scene.js";
import { Transport } from "./transport.js";

const SPEEDS = [0.25, 0.5, 1, 2, 4];

export class Player {
  /**
   * @param {HTMLElement} root Element that is filled.
   * @param {object} parts `{ layout, colours, name }`; the name of who drives, for screen readers.
   */
  constructor(root, parts) {
    Object.assign(this, parts);
    const { layout } = this;
    this.canvas = element("canvas", {});
    this.canvas.setAttribute("role", "img");
    this.stage = new Stage(this.canvas, layout);
    this.said = element("p", { className: "said-line" });
    this.said.setAttribute("role", "status");
    const signals = element("div", { className: "player-bars" });
    this.bars = new Bars(signals, layout);
    this.bars.build([{ letter: "", place: 0 }]);
    this.clock = new Transport(layout.frames / layout.decision_seconds, () => this.show());
    const picture = element("div", { className: "player-picture twin-0" }, this.canvas, this.transport(), this.said);
    root.replaceChildren(picture, signals);
    new ResizeObserver(() => this.show()).observe(this.canvas);
  }

  transport() {
    const { clock, layout } = this;
    const button = (text, act, label = text) => {
      const made = element("button", { type: "button", textContent: text });
      made.setAttribute("aria-label", label);
      made.addEventListener("click", act);
      return made;
    };
    this.play = button("Play", () => (clock.playing ? clock.pause() : clock.play()));
    this.play.removeAttribute("aria-label");
    const back = button("◀\uFE0E", () => clock.step(-1, layout.frames), "One decision back");
    const on = button("▶\uFE0E", () => clock.step(1, layout.frames), "One decision on");
    this.time = element("input", { type: "range", min: 0, step: 0.1, value: 0 });
    this.time.setAttribute("aria-label", "Time in the episode");
    this.time.addEventListener("input", () => {
      clock.playing = false;
      clock.seek(Number(this.time.value));
    });
    this.seconds = element("output", { className: "figure" });
    return element("div", { className: "transport" }, this.play, back, on, this.time, this.seconds, this.speeds());
  }

  speeds() {
    const choice = element("select", {}, ...SPEEDS.map((one) => element("option", { value: one, textContent: `× ${one}` })));
    choice.value = 1;
    choice.setAttribute("aria-label", "Speed");
    choice.addEventListener("change", () => (this.clock.speed = Number(choice.value)));
    return choice;
  }

  /** Take a film, from its beginning; it plays unless the reader wants less motion. */
  load(film) {
    this.film = film;
    this.clock.playing = false;
    this.clock.time = 0;
    this.clock.load(film.frames.length - 1);
    this.time.max = this.clock.end;
    const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.canvas.setAttribute("aria-label", `Crossing seen from above: ${this.name} ${outcomeOf(film, this.layout)}`);
    if (still) this.clock.seek(0);
    else this.clock.play();
  }

  show() {
    const { film, clock, layout } = this;
    if (!film || this.canvas.clientWidth === 0) return;
    const colours = this.colours();
    this.stage.fit(colours);
    const started = clock.time > 0 ? film.decisions[decisionAt(film, clock.time, layout.frames)] : undefined;
    const near = Boolean(started && started.signals[layout.env_signals] > 0);
    const seen = { letter: "", colour: colours.twins[0], braking: started?.braking ?? new Set(), near };
    this.stage.draw(sceneAt(film, clock.time).vehicles, seen, []);
    const made = Math.min(Math.ceil(clock.time / layout.frames), film.decisions.length);
    this.bars.show([sumsOf(film, made, layout.signals.length)]);
    const over = made === film.decisions.length;
    const action = made && !over ? layout.actions[started.action] : "";
    this.said.textContent = over ? `${this.name} ${outcomeOf(film, layout)}` : action;
    this.time.value = clock.time;
    this.seconds.textContent = `${(clock.time / clock.rate).toFixed(1)} s`;
    this.play.textContent = clock.playing ? "Pause" : clock.time >= clock.end ? "Again" : "Play";
  }
}
