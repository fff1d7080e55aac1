// Two episodes of the same traffic side by side, on one clock: what differs between the cars, and what comes of it.

import { outcomeOf, sceneAt } from "./film.js";
import { staged } from "./scene.js";
import { Transport } from "./transport.js";

export class Beside {
  /**
   * @param {string} name Of the tab, with which the names of its elements begin.
   * @param {object} parts `{ layout, colours, extent, scenes }`: `scenes` drives both episodes when the tab is first seen:
   *   `{ title, place, film, said, label }`, with the caption of a frame and the words for screen readers.
   */
  constructor(name, parts) {
    Object.assign(this, parts, { name });
    this.find = (part) => document.getElementById(`${name}-${part}`);
    this.clock = new Transport(this.layout.frames / this.layout.decision_seconds, () => this.show());
    this.find("again").addEventListener("click", () => (this.clock.playing ? this.clock.pause() : this.clock.play()));
    this.find("time").addEventListener("input", ({ target }) => {
      this.clock.playing = false;
      this.clock.seek(Number(target.value));
    });
  }

  /** Drive both episodes, and play them. */
  open() {
    this.shown = this.scenes().map((scene) => {
      const label = `Crossing seen from above, ${scene.title}: ${scene.label}; it ${outcomeOf(scene.film, this.layout)}`;
      return { ...scene, ...staged(scene, label, this.layout, this.extent) };
    });
    this.find("stages").replaceChildren(...this.shown.map(({ figure }) => figure));
    this.clock.time = 0;
    this.clock.load(Math.max(...this.shown.map(({ film }) => film.frames.length - 1)));
    this.find("time").max = this.clock.end;
    if (window.matchMedia("(prefers-reduced-motion: reduce)").matches) this.clock.seek(this.clock.end);
    else this.clock.play();
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
    if (document.getElementById(this.name).hidden) return;
    if (!this.shown) return this.open();
    const { clock } = this;
    const colours = this.colours();
    for (const { film, place, stage, caption, said } of this.shown) {
      stage.fit(colours);
      const { vehicles, people, frame } = sceneAt(film, clock.time);
      stage.draw(vehicles, { letter: "", colour: colours.twins[place], braking: new Set(), near: false }, [], people);
      const text = said(frame);
      if (caption.textContent !== text) caption.textContent = text;
    }
    this.find("time").value = clock.time;
    this.find("clock").textContent = `${(clock.time / clock.rate).toFixed(1)} s`;
    this.find("again").textContent = clock.playing ? "Pause" : "Play";
  }
}
