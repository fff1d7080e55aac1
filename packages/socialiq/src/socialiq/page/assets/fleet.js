// Fleets: one, four or all of a junction's eight cars at the visitor's angle, counted as they drive.

import { keepAddress } from "./address.js";
import { element } from "./bars.js";
import { sceneAt } from "./film.js";
import { Knob } from "./knob.js";
import { dialOf } from "./network.js";
import { WHOLE } from "./road.js";
import { Stage } from "./scene.js";
import { Transport } from "./transport.js";

const FIRST_SEED = 1; // as of the rates that were measured
const COUNTED = { rate: "a minute", arrival: "through", collision: "collided", timeout: "waiting" };

/** Episodes of a fleet, and what became of its cars. */
export class Fleet {
  /**
   * @param {Recorder} recorder Of a core with several agents.
   * @param {number} count Number of cars of the second network.
   * @param {object[]} networks Of the other cars, and of these.
   */
  constructor(recorder, count, networks) {
    Object.assign(this, { recorder, count, networks, layout: recorder.core.layout, seconds: 0 });
    this.ended = new Map(Object.values(this.layout.endings).map((ending) => [ending, 0]));
  }

  /** Begin the episode of a seed; cars of the second network are the one of this number and those after it. */
  begin(seed) {
    const { agents } = this.layout;
    const after = (agent) => (((agent - seed) % agents) + agents) % agents;
    this.film = this.recorder.begin(seed);
    this.counted = this.film.endings;
    this.group = Array.from({ length: agents }, (_, agent) => Number(after(agent) < this.count));
    this.over = false;
  }

  /** Every car that has not ended decides; `settle` counts what comes of it. */
  decide() {
    const { recorder, film, group, networks, layout } = this;
    const choose = (number, agent) => networks[number].decide(recorder.core.observation(0, agent), film.decisions.length);
    const actions = group.map((number, agent) => (film.endings[agent] === layout.endings.none ? choose(number, agent) : 0));
    this.over = !recorder.decide(...actions);
  }

  get settled() {
    return this.counted === this.film.endings;
  }

  /** Count the last decision, once it has been shown. */
  settle() {
    if (this.settled) return;
    this.film.endings.forEach((ending, agent) => ending !== this.counted[agent] && this.ended.set(ending, this.ended.get(ending) + 1));
    this.seconds += this.layout.decision_seconds;
    this.counted = this.film.endings;
  }

  /** Numbers of `COUNTED`. */
  get counts() {
    const [arrival, collision, timeout] = ["arrival", "collision", "timeout"].map((name) => this.ended.get(this.layout.endings[name]));
    return { arrival, collision, timeout, rate: this.seconds ? (60 * arrival) / this.seconds : 0 };
  }
}

/** The tab: three fleets that drive the same seeds, one after another. */
export class Fleets {
  /**
   * @param {object} parts `{ layout, dials, counts, rates, recorder, colours }`: of several agents; `recorder` makes one.
   * @param {object} state Of `address.readAddress`; its `fleet` is the angle, `trained` the number of the dial.
   */
  constructor(parts, state) {
    Object.assign(this, parts, { state, opened: [], rates: rowsOf(parts.rates) });
    this.find = (name) => document.getElementById(`fleet-${name}`);
    this.clock = new Transport(this.layout.frames / this.layout.decision_seconds, () => this.moved());
    [this.range] = this.dials.map(({ range }) => range);
    this.knob = new Knob(this.find("dial"), this.range, (angle) => this.change({ fleet: angle }));
    this.find("others").textContent = `${this.range[0]}°`;
    this.find("trained").replaceChildren(...this.dials.map(({ name }, number) => new Option(name, number, false, number === state.trained)));
    this.find("trained").addEventListener("change", ({ target }) => this.change({ trained: Number(target.value) }));
    this.find("play").addEventListener("click", () => (this.clock.playing ? this.clock.pause() : this.start()));
    this.find("speed").append(...[...document.getElementById("speed").options].map((option) => option.cloneNode(true)));
    this.find("speed").addEventListener("change", ({ target }) => { state.speed = target.value; keepAddress(state); });
    this.scenes = this.counts.map((count) => this.scene(count));
    this.find("stages").replaceChildren(...this.scenes.map(({ figure }) => figure));
    this.show();
  }

  scene(count) {
    const canvas = element("canvas", {});
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", "Crossing seen from above");
    const [title, said] = [element("strong", {}), element("span", { className: "said" })];
    const numbers = Object.fromEntries(Object.keys(COUNTED).map((name) => [name, element("dd", {})]));
    const tally = Object.entries(COUNTED).map(([name, words]) => element("div", {}, element("dt", { textContent: words }), numbers[name]));
    const note = element("p", { className: "hint" });
    const figure = element("figure", { className: "stage twin-1" }, element("figcaption", {}, title, said), canvas, element("dl", { className: "tally" }, ...tally), note);
    return { count, canvas, title, said, numbers, note, figure, stage: new Stage(canvas, this.layout, WHOLE) };
  }

  /** Take another angle or dial, and count again. */
  change(chosen) {
    Object.assign(this.state, chosen);
    this.restart();
    if (this.clock.playing) this.advance();
    this.show();
    keepAddress(this.state);
  }

  /** Count from the first seed on. The cores are made when the tab is first seen. */
  restart() {
    const { state, dials, range } = this;
    this.recorders ??= this.counts.map(() => this.recorder());
    this.opened[state.trained] ??= dialOf(dials[state.trained].bytes());
    const networks = [range[0], state.fleet].map((angle) => this.opened[state.trained].at(angle));
    this.fleets = this.counts.map((count, number) => new Fleet(this.recorders[number], count, networks));
    this.begin(FIRST_SEED);
    this.knob.show([{ angle: state.fleet, letter: "", place: 1 }], 0);
    this.find("angle").textContent = `${state.fleet}°`;
    this.measured();
    this.tally();
  }

  /** What was measured of this dial at the nearest angle, under each scene and of all cars. */
  measured() {
    const rates = this.rates.filter(({ dial }) => dial === this.state.trained);
    const rows = nearestRates(rates, this.state.fleet);
    rows.forEach(({ per_minute: rate, collision }, place) => {
      this.scenes[place].note.textContent = `measured: ${rate.toFixed(1)} a minute, ${(100 * collision).toFixed(1)} % collide`;
    });
    this.find("measured").textContent = rows.length ? verdict(rows[rows.length - 1], rates[rows.length - 1]) : "";
  }

  begin(seed) {
    this.seed = seed;
    for (const fleet of this.fleets) fleet.begin(seed);
    Object.assign(this.clock, { time: 0, end: 0 });
  }

  start() {
    if (this.clock.time >= this.clock.end) this.advance();
    this.clock.play();
  }

  pause() {
    if (this.clock.playing) this.clock.pause();
  }

  /** Count what was shown, then take the next decisions, of the next seed once all fleets have ended. */
  advance() {
    const { fleets, clock } = this;
    for (const fleet of fleets) fleet.settle();
    if (fleets.every(({ over }) => over)) this.begin(this.seed + 1);
    for (const fleet of fleets) if (!fleet.over) fleet.decide();
    clock.load(Math.max(...fleets.map(({ film }) => film.frames.length - 1)));
    this.tally();
  }

  moved() {
    const { clock } = this;
    if (clock.time >= clock.end && clock.end > 0 && !clock.playing) {
      this.advance();
      clock.playing = true;
    }
    this.show();
  }

  show() {
    if (this.find("stages").offsetParent === null) return; // in a tab that is hidden
    if (!this.fleets) {
      this.restart();
      if (!window.matchMedia("(prefers-reduced-motion: reduce)").matches) this.start();
    }
    const { clock, state } = this;
    clock.speed = Number(state.speed);
    this.find("speed").value = state.speed;
    this.find("play").textContent = clock.playing ? "Pause" : "Play";
    const colours = this.colours();
    this.scenes.forEach(({ stage }, number) => {
      const { film, group } = this.fleets[number];
      stage.fit(colours);
      const { vehicles } = sceneAt(film, clock.time);
      for (const one of vehicles) if (one.ego) one.colour = colours.twins[group[one.agent]];
      stage.draw(vehicles, { letter: "", colour: "", braking: new Set(), near: false }, []);
    });
  }

  /** Numbers and texts, once a decision. */
  tally() {
    const { fleet: angle } = this.state;
    this.find("seed").textContent = `seed ${this.seed}`;
    this.scenes.forEach(({ count, canvas, title, said, numbers }, place) => {
      const { counts, over, settled, film } = this.fleets[place];
      const cars = `${count === this.layout.agents ? "all" : `${count} of`} ${this.layout.agents} cars at ${angle}°`;
      title.textContent = cars;
      said.textContent = over && settled ? `done after ${film.decisions.length * this.layout.decision_seconds} s` : "";
      for (const name of Object.keys(COUNTED)) numbers[name].textContent = counts[name].toFixed(name === "rate" ? 1 : 0);
      canvas.setAttribute("aria-label", `Crossing seen from above, ${cars}: ${counts.arrival} through, ${counts.collision} collided, ${counts.timeout} waiting`);
    });
  }

  /** Arrow keys turn the dial wherever the focus is, space plays; return whether a key was meant. */
  key(event) {
    if (event.key.startsWith("Arrow")) this.knob.key(event);
    else if (event.key !== " " || event.target.closest("button")) return false;
    else if (this.clock.playing) this.clock.pause();
    else this.start();
    return true;
  }
}

/** Return the rows of a table that is given by its columns. */
function rowsOf(columns) {
  const names = Object.keys(columns);
  return (columns.dial ?? []).map((_, number) => Object.fromEntries(names.map((name) => [name, columns[name][number]])));
}

/** Return the measured rows of one dial at the angle nearest to this one, by count. */
function nearestRates(rates, angle) {
  const apart = Math.min(...rates.map((row) => Math.abs(row.angle - angle)));
  const nearest = rates.find((row) => Math.abs(row.angle - angle) === apart)?.angle;
  return rates.filter((row) => row.angle === nearest);
}

/** Return what a fleet of one angle does otherwise than that of the lowest angle, by their intervals. */
function verdict(chosen, lowest) {
  const measured = `Measured over ${chosen.episodes} episodes of each, from seed ${FIRST_SEED}`;
  if (chosen.angle === lowest.angle) return `${measured}.`;
  const changes = [["per_minute", "get through", "a minute", 1], ["collision", "collide", "%", 100], ["timeout", "wait", "%", 100]].map(([name, act, unit, factor]) => {
    const than = chosen[`${name}_low`] > lowest[`${name}_high`] ? "more" : chosen[`${name}_high`] < lowest[`${name}_low`] ? "fewer" : "about as many";
    const [here, there] = [chosen, lowest].map((row) => (factor * row[name]).toFixed(1));
    return `${than} ${act} (${here} instead of ${there} ${unit})`;
  }).filter((text, number) => number < 2 || !text.startsWith("about"));
  return `${measured}: if all drive at ${chosen.angle}° and not at ${lowest.angle}°, ${changes.slice(0, -1).join(", ")} and ${changes[changes.length - 1]}.`;
}
