// People on foot and on bicycles: the same episode, driven by an altruist that weighs vehicles alone and by one that weighs people.

import { element } from "./bars.js";
import { filmOfActions, outcomeOf, sceneAt } from "./film.js";
import { Stage } from "./scene.js";
import { Transport } from "./transport.js";

const AROUND = { reach: 32, south: 3 }; // m; the crosswalks and the bicycle lanes before them
const NAMES = ["weighs vehicles alone", "weighs people alone"];

export class People {
  /** @param {object} parts `{ layout, seed, angle, drivers, recorder, colours }`: of `page.people`; `recorder` makes one. */
  constructor(parts) {
    Object.assign(this, parts);
    this.find = (name) => document.getElementById(`people-${name}`);
    this.clock = new Transport(this.layout.frames / this.layout.decision_seconds, () => this.show());
    this.find("again").addEventListener("click", () => (this.clock.playing ? this.clock.pause() : this.clock.play()));
    this.find("time").addEventListener("input", ({ target }) => {
      this.clock.playing = false;
      this.clock.seek(Number(target.value));
    });
    this.find("angle").textContent = `${this.angle}°`;
    this.find("seed").textContent = `seed ${this.seed}`;
  }

  /** Drive both episodes when the tab is first seen. */
  open() {
    const recorder = this.recorder();
    this.scenes = this.drivers.map(({ actions }, place) => {
      const film = filmOfActions(recorder, this.seed, actions);
      const [canvas, said] = [element("canvas", {}), element("p", { className: "caption" })];
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `Crossing seen from above, the car ${NAMES[place]}. ${this.waits(film, film.frames.length - 1)}; it ${outcomeOf(film, this.layout)}`);
      const title = element("figcaption", {}, element("strong", { textContent: `The car ${NAMES[place]}` }));
      const figure = element("figure", { className: `stage twin-${place}` }, title, canvas, said);
      return { film, place, canvas, said, figure, stage: new Stage(canvas, this.layout, AROUND) };
    });
    this.find("stages").replaceChildren(...this.scenes.map(({ figure }) => figure));
    this.clock.load(Math.max(...this.scenes.map(({ film }) => film.frames.length - 1)));
    this.find("time").max = this.clock.end;
    if (window.matchMedia("(prefers-reduced-motion: reduce)").matches) this.clock.seek(this.clock.end);
    else this.clock.play();
  }

  /** Seconds that people lost by waiting for the car up to a frame. */
  waits(film, frame) {
    const [walking, riding] = film.frames[frame].waited;
    return `People on foot wait ${walking.toFixed(1)} s for it, cyclists ${riding.toFixed(1)} s`;
  }

  pause() {
    if (this.clock.playing) this.clock.pause();
  }

  key(event) {
    if (event.key !== " " || event.target.closest("button")) return false;
    this.find("again").click();
    return true;
  }

  show() {
    if (document.getElementById("people").hidden) return;
    if (!this.scenes) return this.open();
    const { clock } = this;
    const colours = this.colours();
    for (const { film, place, stage, said } of this.scenes) {
      stage.fit(colours);
      const { vehicles, people, frame } = sceneAt(film, clock.time);
      stage.draw(vehicles, { letter: "", colour: colours.twins[place], braking: new Set(), near: false }, [], people);
      const over = frame === film.frames.length - 1 ? `; it ${outcomeOf(film, this.layout)}` : "";
      const text = this.waits(film, frame) + over;
      if (said.textContent !== text) said.textContent = text;
    }
    this.find("time").value = clock.time;
    this.find("clock").textContent = `${(clock.time / clock.rate).toFixed(1)} s`;
    this.find("again").textContent = clock.playing ? "Pause" : "Play";
  }
}
