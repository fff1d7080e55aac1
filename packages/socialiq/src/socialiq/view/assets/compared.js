// A policy of the user's beside the dial of the package, on the same seed.

import { Bars, element, signed } from "../../page/assets/bars.js";
import { Core } from "../../page/assets/core.js";
import { Curve } from "../../page/assets/curve.js";
import { differing, summaryOf } from "../../page/assets/episodes.js";
import { Recorder, decisionAt, filmOf, outcomeOf, sceneAt, sumsOf } from "../../page/assets/film.js";
import { Knob } from "../../page/assets/knob.js";
import { Stage } from "../../page/assets/scene.js";
import { episodesBy, filmBy } from "./asked.js";
import { Connection } from "./connection.js";
import { Controls, stateOf } from "./controls.js";

const ROWS = 50; // episodes side by side
const BACKGROUND = 200; // episodes of a run
const SEARCHED = 100; // seeds among which those that differ most are looked for
const MOST_SEED = 2 ** 53 - 1;
const RANGE = [0, 90]; // degrees that can be asked for
const [OWN, DIAL] = [0, 1];

export class Compared {
  /**
   * @param {object} parts `{ module, layout, dial, range, curve, colours, complain }` of the page.
   * @param {object} shown `{ name, dial }`: of the policy; `dial` is null unless it is a dial.
   */
  constructor(parts, shown) {
    Object.assign(this, parts, { shown });
    this.find = (name) => document.getElementById(name);
    const own = shown.dial?.angle ?? 0;
    this.state = stateOf({
      seed: [12, 0, MOST_SEED], angle: [45, 0, 90], own: [own, 0, 90], chosen: [OWN, 0, 1], step: [0, 0, 400], speed: [1, 0.25, 4, 0.25],
    });
    this.server = new Connection((line) => this.complain(line));
    this.recorders = [OWN, DIAL].map(() => new Recorder(new Core(this.module, this.layout, 1, true)));
    this.measured = [new Map(), new Map()];
    this.drive = 0;
    this.bars = new Bars(this.find("bars"), this.layout);
    this.plot = new Curve(this.find("curve"), this.curve);
    this.knob = new Knob(this.find("dial"), RANGE, (angle) => this.turn(angle), (place) => this.choose(place));
    this.controls = new Controls(this.layout.frames / this.layout.decision_seconds, this.layout.frames, this.state, () => this.show());
    this.arrange();
    this.listen();
    this.refilm(this.state.step === 0);
  }

  /** The user's policy and the dial; only a dial of the user's has an angle that turns. */
  get twins() {
    const { angle, own } = this.state;
    return [
      { letter: "A", place: OWN, angle: own, name: this.shown.dial ? `${this.shown.name}, ${own}°` : this.shown.name },
      { letter: "B", place: DIAL, angle, name: `dial, ${angle}°` },
    ];
  }

  get turned() {
    return this.shown.dial ? this.state.chosen : DIAL;
  }

  arrange() {
    this.stages = this.twins.map((twin) => {
      const canvas = element("canvas", { role: "img" });
      const [title, said] = [element("strong", { className: "name" }), element("span", { className: "said" })];
      const head = element("figcaption", {}, element("span", { className: `badge twin-${twin.place}`, textContent: twin.letter }), title, said);
      const figure = element("figure", { className: `stage twin-${twin.place}` }, head, canvas);
      return { canvas, title, said, figure, stage: new Stage(canvas, this.layout) };
    });
    this.find("stages").replaceChildren(...this.stages.map(({ figure }) => figure));
    this.bars.build(this.twins);
  }

  listen() {
    const on = (name, event, act) => this.find(name).addEventListener(event, act);
    on("next", "click", () => this.toSeed(this.state.seed + 1));
    on("seed", "change", (event) => this.typeSeed(event.target));
    on("run", "click", () => this.runEpisodes());
    on("differ", "click", () => this.searchSeeds());
    new ResizeObserver(() => this.show()).observe(document.querySelector("main"));
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.show());
  }

  turn(angle) {
    const [low, high] = this.turned === OWN ? [this.shown.dial.low, this.shown.dial.high] : this.range;
    const within = Math.min(Math.max(angle, Math.ceil(low)), Math.floor(high));
    this.state[this.turned === OWN ? "own" : "angle"] = within;
    this.refilm(false);
  }

  toSeed(seed) {
    this.state.seed = Math.min(seed, MOST_SEED);
    this.refilm(true);
  }

  typeSeed(field) {
    const seed = Number(field.value);
    const right = field.value.trim() !== "" && Number.isInteger(seed) && seed >= 0 && seed <= MOST_SEED;
    this.say(right ? "" : "A seed is a whole number from 0 on.");
    if (right) this.toSeed(seed);
    else field.value = this.state.seed;
  }

  /** Return a function that asks the server for the policy's decisions. */
  asking() {
    const angle = this.shown.dial ? this.state.own : null;
    return async (observations, decisions) => {
      const answer = await this.server.ask({ observations: observations.map((one) => [...one]), decisions, angle });
      return answer.actions;
    };
  }

  /** Return the dial's decisions in the same form. */
  deciding() {
    const network = this.dial.at(this.state.angle);
    return async (observations, decisions) => observations.map((one, place) => network.decide(one, decisions[place]));
  }

  /** Drive the seed again: the dial at once, the policy as fast as it answers. */
  async refilm(rewound) {
    const drive = (this.drive += 1);
    const { seed } = this.state;
    this.find("seed").value = seed;
    this.labels();
    const beside = filmOf(this.recorders[DIAL], this.dial.at(this.state.angle), seed);
    try {
      const own = await filmBy(this.recorders[OWN], this.asking(), seed, () => this.drive === drive);
      if (!own) return;
      this.films = [own, beside];
      this.controls.load(Math.max(...this.films.map((film) => film.frames.length - 1)), rewound);
      this.find("summary").textContent = this.twins.map(({ name }, place) => `${name} ${outcomeOf(this.films[place], this.layout)}.`).join(" ");
      document.documentElement.dataset.ready = "yes";
    } catch (error) {
      if (this.drive === drive) this.complain(error.message);
    }
  }

  /** Knob, chips and names of the present angles. */
  labels() {
    const { twins } = this;
    const hands = this.shown.dial ? twins : [twins[DIAL]];
    this.knob.show(hands, hands.findIndex(({ place }) => place === this.turned));
    this.find("angle").textContent = `${twins[this.turned].angle}°`;
    const focused = this.find("chips").contains(document.activeElement);
    this.find("chips").replaceChildren(...hands.map(({ letter, angle, place }) => this.chip(letter, angle, place)));
    if (focused) this.find("chips").querySelector('[aria-pressed="true"]').focus();
    this.stages.forEach(({ title }, place) => (title.textContent = twins[place].name));
    this.plotted();
    this.table();
  }

  chip(letter, angle, place) {
    const chip = element("button", { type: "button", className: `chip twin-${place}`, textContent: `${letter} ${angle}°` });
    chip.setAttribute("aria-pressed", String(place === this.turned));
    chip.addEventListener("click", () => this.choose(place));
    return chip;
  }

  choose(place) {
    this.state.chosen = place;
    this.labels();
  }

  show() {
    if (!this.films) return;
    const { clock } = this.controls;
    const { layout } = this;
    const colours = this.colours();
    this.films.forEach((film, place) => {
      const { stage, canvas, said } = this.stages[place];
      const twin = this.twins[place];
      stage.fit(colours);
      const now = clock.time > 0 ? film.decisions[decisionAt(film, clock.time, layout.frames)] : undefined;
      const near = Boolean(now && now.signals[layout.env_signals] > 0);
      stage.draw(sceneAt(film, clock.time).vehicles, { ...twin, colour: colours.twins[place], braking: now?.braking ?? new Set(), near }, []);
      canvas.setAttribute("aria-label", `Crossing seen from above, ${twin.name} ${outcomeOf(film, layout)}`);
      const over = clock.time >= film.frames.length - 1;
      said.textContent = over ? outcomeOf(film, layout) : now ? layout.actions[now.action] : "";
    });
    const made = this.films.map((film) => Math.min(Math.ceil(clock.time / layout.frames), film.decisions.length));
    this.bars.show(this.films.map((film, place) => sumsOf(film, made[place], layout.signals.length)));
  }

  /** Measured results of each twin at its present angle. */
  get found() {
    return this.twins.map(({ angle, place }) => this.measured[place].get(angle));
  }

  /** The dial's place on its curve, and the policy's once it is measured. */
  plotted() {
    const [own] = this.found;
    const twins = this.twins.filter(({ place }) => place === DIAL || own);
    const named = twins.map((twin) => (twin.place === OWN ? { ...twin, angle: undefined } : twin));
    this.plot.show(named, named.map(({ place }) => this.found[place]));
  }

  /** Drive some seeds with both; return their episodes. */
  async drivenBoth(first, count) {
    const driven = [];
    for (const decide of [this.asking(), this.deciding()]) {
      const core = new Core(this.module, this.layout, ROWS, false);
      const episodes = [];
      while (episodes.length < count) {
        const seeds = Array.from({ length: Math.min(ROWS, count - episodes.length) }, (_, number) => first + episodes.length + number);
        episodes.push(...(await episodesBy(core, decide, seeds)));
        this.say(`${driven.length ? "dial" : this.shown.name}: ${episodes.length} of ${count} episodes ...`);
      }
      driven.push(episodes);
    }
    return driven;
  }

  runEpisodes() {
    const angles = this.twins.map(({ angle }) => angle);
    return this.busy(1, BACKGROUND, (driven) => {
      driven.forEach((episodes, place) => this.measured[place].set(angles[place], summaryOf(episodes, this.layout.endings)));
      this.labels();
    });
  }

  searchSeeds() {
    const first = this.state.seed + 1 + SEARCHED > MOST_SEED ? 0 : this.state.seed + 1;
    return this.busy(first, SEARCHED, (driven) => {
      const name = (ending) => Object.keys(this.layout.endings).find((key) => this.layout.endings[key] === ending);
      const buttons = differing(driven, 5).map(({ seed, endings }) => {
        const words = endings.map((ending, place) => `${"AB"[place]} ${name(ending)}`).join(", ");
        const button = element("button", { type: "button", className: "plain" }, `seed ${seed}`, element("small", { textContent: words }));
        button.addEventListener("click", () => this.toSeed(seed));
        return element("li", {}, button);
      });
      this.find("found").replaceChildren(...buttons);
    });
  }

  /** Drive seeds in the background, use the episodes, and say how long it took. */
  async busy(first, count, use) {
    const buttons = ["run", "differ"].map(this.find);
    buttons.forEach((button) => (button.disabled = true));
    const begun = performance.now();
    try {
      use(await this.drivenBoth(first, count));
      this.say(`${count} episodes of both: ${((performance.now() - begun) / 1000).toFixed(1)} s`);
    } catch (error) {
      this.complain(error.message);
      this.say("");
    } finally {
      buttons.forEach((button) => (button.disabled = false));
    }
  }

  /** Rates and means with their intervals. */
  table() {
    const cell = (text, extent) => element("td", {}, text, element("small", { textContent: extent }));
    const percent = ([share, low, high]) => cell(`${(100 * share).toFixed(1)} %`, `${(100 * low).toFixed(1)} to ${(100 * high).toFixed(1)}`);
    const mean = ([value, low, high]) => cell(signed(value), `${signed(low)} to ${signed(high)}`);
    const rows = this.twins.filter(({ place }) => this.found[place]).map(({ letter, place, name }) => {
      const found = this.found[place];
      const head = element("th", { scope: "row" }, element("span", { className: `badge twin-${place}`, textContent: letter }), ` ${name}`);
      return element("tr", {}, head, percent(found.arrival), percent(found.collision), mean(found.env), mean(found.social));
    });
    this.find("rates").replaceChildren(...rows);
    this.find("rates").closest("table").hidden = rows.length === 0;
  }

  say(text) {
    this.find("said").textContent = text;
  }
}
