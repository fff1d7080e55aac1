// The first tab: the same traffic and seed driven at two or three angles.

import { FIRST, keepAddress } from "./address.js";
import { Bars, element, signed } from "./bars.js";
import { Curve } from "./curve.js";
import { differing, summaryOf } from "./episodes.js";
import { decisionAt, filmOf, outcomeOf, sceneAt, sumsOf } from "./film.js";
import { Knob } from "./knob.js";
import { Stage } from "./scene.js";
import { shifted } from "./shifts.js";
import { Transport } from "./transport.js";

export const LETTERS = ["A", "B", "C"];
const BACKGROUND = 500; // episodes of a run in the background
const SEARCHED = 150; // seeds among which those that differ most are looked for
const FAULTS = { latency: "s", unseen: "%", noise: "m" }; // sliders, with their units
const MOST_SEED = 2 ** 53 - 1;

export class Twins {
  /**
   * @param {object} parts `{ layout, dial, range, recorder, curve, background, colours }` of the page.
   * @param {object} state Of `address.readAddress`; changed in place.
   */
  constructor(parts, state) {
    Object.assign(this, parts);
    this.state = state;
    this.find = (name) => document.getElementById(name);
    this.bars = new Bars(this.find("bars"), this.layout);
    this.plot = new Curve(this.find("curve"), this.curve);
    this.knob = new Knob(this.find("dial"), this.range, (angle) => this.turn(angle), (place) => this.choose(place));
    this.clock = new Transport(this.layout.frames / this.layout.decision_seconds, () => this.show());
    this.measured = new Map();
    this.listen();
    this.clock.time = state.step;
    this.arrange();
  }

  get twins() {
    return this.state.angles.map((angle, place) => ({ angle, place, letter: LETTERS[place] }));
  }

  listen() {
    const { clock, layout } = this;
    const on = (name, event, act) => this.find(name).addEventListener(event, act);
    on("play", "click", () => (clock.playing ? clock.pause() : clock.play()));
    on("back", "click", () => clock.step(-1, layout.frames));
    on("step", "click", () => clock.step(1, layout.frames));
    on("time", "input", (event) => { clock.playing = false; clock.seek(Number(event.target.value)); });
    on("speed", "change", (event) => { this.state.speed = event.target.value; this.keep(); });
    on("next", "click", () => this.toSeed(this.state.seed + 1));
    on("seed", "change", (event) => this.typeSeed(event.target));
    on("differ", "click", () => this.searchSeeds());
    on("run", "click", () => this.runEpisodes());
    on("ghosts", "change", (event) => { this.state.view = event.target.checked ? "ghosts" : "side"; this.arrange(); });
    on("third", "click", () => this.toggleThird());
    for (const name of Object.keys(FAULTS)) on(name, "input", ({ target }) => this.fault({ [name]: Number(target.value) }));
    on("front", "change", ({ target }) => this.fault({ front: Number(target.checked) }));
  }

  /** The faults under which the twins drive. */
  get shift() {
    const { latency, unseen, noise, front } = this.state;
    return { latency, unseen: unseen / 100, noise, front: Boolean(front) };
  }

  /** Drive with other faults, of which nothing has been measured yet. */
  fault(changed) {
    Object.assign(this.state, changed);
    this.measured.clear();
    this.refilm();
  }

  showFaults() {
    for (const [name, unit] of Object.entries(FAULTS)) {
      const words = `${this.state[name]} ${unit}`;
      this.find(name).value = this.state[name];
      this.find(name).setAttribute("aria-valuetext", words);
      this.find(`${name}-said`).textContent = words;
    }
    this.find("front").checked = Boolean(this.state.front);
  }

  /** Build what depends on the number of twins and the view, then film and show. */
  arrange() {
    const { state } = this;
    this.stages = [];
    const shown = state.view === "ghosts" ? [this.twins[state.chosen]] : this.twins;
    this.find("stages").replaceChildren(...shown.map((twin) => this.stageOf(twin)));
    this.find("stages").dataset.count = shown.length;
    this.find("ghosts").checked = state.view === "ghosts";
    this.find("third").textContent = state.angles.length === 3 ? "Remove twin C" : "Add a twin";
    this.find("speed").value = state.speed;
    this.chips();
    this.bars.build(this.twins);
    this.refilm();
  }

  stageOf(twin) {
    const canvas = element("canvas", { role: "img" });
    const title = element("strong", { textContent: `${twin.angle}°` });
    const said = element("span", { className: "said" });
    const head = element("figcaption", {}, element("span", { className: `badge twin-${twin.place}`, textContent: twin.letter }), title, said);
    this.stages.push({ twin, canvas, title, said, stage: new Stage(canvas, this.layout) });
    return element("figure", { className: `stage twin-${twin.place}` }, head, canvas);
  }

  chips() {
    const chips = this.twins.map(({ letter, angle, place }) => {
      const chip = element("button", { type: "button", className: `chip twin-${place}`, textContent: `${letter} ${angle}°` });
      chip.setAttribute("aria-pressed", String(place === this.state.chosen));
      chip.addEventListener("click", () => this.choose(place));
      return chip;
    });
    const focused = this.find("chips").contains(document.activeElement);
    this.find("chips").replaceChildren(...chips);
    if (focused) this.find("chips").querySelector('[aria-pressed="true"]').focus();
  }

  choose(place) {
    this.state.chosen = place;
    if (this.state.view === "ghosts") this.arrange();
    else this.refilm();
    this.chips();
  }

  turn(angle) {
    const { state } = this;
    state.angles[state.chosen] = angle;
    this.refilm();
    this.chips();
  }

  toggleThird() {
    const { state } = this;
    const [low, high] = this.range;
    const free = FIRST.angles.find((angle) => angle >= low && angle <= high && !state.angles.includes(angle));
    if (state.angles.length === 3) state.angles.pop();
    else state.angles.push(free ?? high);
    state.chosen = Math.min(state.chosen, state.angles.length - 1);
    this.arrange();
  }

  toSeed(seed) {
    this.state.seed = seed;
    this.clock.time = 0;
    this.refilm();
    if (!window.matchMedia("(prefers-reduced-motion: reduce)").matches) this.clock.play();
  }

  typeSeed(field) {
    const seed = Number(field.value);
    const right = field.value.trim() !== "" && Number.isInteger(seed) && seed >= 0 && seed <= MOST_SEED;
    this.say(right ? "" : "A seed is a whole number from 0 on.");
    if (right) this.toSeed(seed);
    else field.value = this.state.seed;
  }

  /** Drive the seed again at every angle; it takes a few milliseconds. */
  refilm() {
    this.films = this.twins.map(({ angle }) => filmOf(this.recorder, shifted(this.dial.at(angle), this.shift), this.state.seed));
    this.showFaults();
    this.clock.load(Math.max(...this.films.map((film) => film.frames.length - 1)));
    this.find("time").max = this.clock.end;
    this.find("seed").value = this.state.seed;
    this.knob.show(this.twins, this.state.chosen);
    this.find("angle").textContent = `${this.twins[this.state.chosen].angle}°`;
    const words = this.twins.map(({ letter, angle }, number) => `${letter} at ${angle}° ${outcomeOf(this.films[number], this.layout)}.`);
    this.find("summary").textContent = words.join(" ");
    this.plot.show(this.twins, this.twins.map(({ angle }) => this.measured.get(angle)));
    this.table();
    this.shownDecisions = "";
    this.show();
  }

  show() {
    if (!this.films) return;
    const { clock, layout } = this;
    clock.speed = Number(this.state.speed);
    const colours = this.colours();
    const scenes = this.films.map((film) => sceneAt(film, clock.time));
    for (const { twin, stage } of this.stages) {
      stage.fit(colours);
      const film = this.films[twin.place];
      const now = film.decisions[decisionAt(film, clock.time, layout.frames)];
      const started = clock.time > 0 ? now : undefined;
      const near = Boolean(started && started.signals[layout.env_signals] > 0);
      const seen = { ...twin, colour: colours.twins[twin.place], braking: started?.braking ?? new Set(), near };
      stage.draw(scenes[twin.place].vehicles, seen, this.state.view === "ghosts" ? this.ghosts(scenes, twin, colours) : []);
    }
    this.labels();
    this.find("time").value = clock.time;
    this.find("clock").textContent = `${(clock.time / clock.rate).toFixed(1)} s`;
    this.find("play").textContent = clock.playing ? "Pause" : clock.time >= clock.end ? "Again" : "Play";
    if (!clock.playing) this.keep();
  }

  ghosts(scenes, twin, colours) {
    return this.twins
      .filter(({ place }) => place !== twin.place)
      .map(({ place, letter }) => ({ vehicle: scenes[place].vehicles.find((one) => one.ego), letter, colour: colours.twins[place] }))
      .filter(({ vehicle }) => vehicle);
  }

  /** Texts and bars change once a decision, not with every picture. */
  labels() {
    const { clock, layout } = this;
    const made = this.films.map((film) => Math.min(Math.ceil(clock.time / layout.frames), film.decisions.length));
    const shown = `${made} ${this.state.seed} ${this.state.angles}`;
    if (shown === this.shownDecisions) return;
    this.shownDecisions = shown;
    this.bars.show(this.films.map((film, number) => sumsOf(film, made[number], layout.signals.length)));
    for (const { twin, canvas, title, said } of this.stages) {
      const film = this.films[twin.place];
      const { angle } = this.twins[twin.place];
      canvas.setAttribute("aria-label", `Crossing seen from above, twin ${twin.letter} at ${angle} degrees ${outcomeOf(film, layout)}`);
      const over = made[twin.place] === film.decisions.length;
      title.textContent = `${angle}°`;
      const action = film.decisions[Math.max(made[twin.place] - 1, 0)].action;
      said.textContent = over ? outcomeOf(film, layout) : made[twin.place] ? layout.actions[action] : "";
    }
  }

  async runEpisodes() {
    const angles = [...new Set(this.state.angles)];
    await this.ask({ angles, first: 1, count: BACKGROUND, shift: this.shift }, `${BACKGROUND} episodes at each angle`, (found) => {
      angles.forEach((angle, number) => this.measured.set(angle, summaryOf(found[number], this.layout.endings)));
      this.refilm();
    }, "ran");
  }

  async searchSeeds() {
    const { angles, seed } = this.state;
    const first = seed + 1 + SEARCHED > MOST_SEED ? 0 : seed + 1;
    await this.ask({ angles, first, count: SEARCHED, shift: this.shift }, `looking through ${SEARCHED} seeds`, (found) => {
      const name = (ending) => Object.keys(this.layout.endings).find((key) => this.layout.endings[key] === ending);
      const buttons = differing(found, 5).map((one) => {
        const words = one.endings.map((ending, place) => `${LETTERS[place]} ${name(ending)}`).join(", ");
        const button = element("button", { type: "button", className: "plain" }, `seed ${one.seed}`, element("small", { textContent: words }));
        button.addEventListener("click", () => this.toSeed(one.seed));
        return element("li", {}, button);
      });
      this.find("found").replaceChildren(...buttons);
    });
  }

  /** Ask the worker; say what runs, how long it took, or what went wrong. */
  async ask(question, what, use, place = "said") {
    this.say(`${what} ...`, place);
    const begun = performance.now();
    try {
      use(await this.background(question));
      this.say(`${what}: ${((performance.now() - begun) / 1000).toFixed(1)} s`, place);
    } catch (error) {
      this.say(error.message, place);
    }
  }

  /** Rates and means of the runs in the background, with their intervals. */
  table() {
    const rows = this.twins.filter(({ angle }) => this.measured.has(angle)).map(({ letter, angle, place }) => {
      const found = this.measured.get(angle);
      const cell = (text, extent) => element("td", {}, text, element("small", { textContent: extent }));
      const percent = ([share, low, high]) => cell(`${(100 * share).toFixed(1)} %`, `${(100 * low).toFixed(1)} to ${(100 * high).toFixed(1)}`);
      const mean = ([value, low, high]) => cell(signed(value), `${signed(low)} to ${signed(high)}`);
      const head = element("th", { scope: "row" }, element("span", { className: `badge twin-${place}`, textContent: letter }), ` ${angle}°`);
      return element("tr", {}, head, percent(found.arrival), percent(found.collision), mean(found.env), mean(found.social));
    });
    this.find("rates").replaceChildren(...rows);
    this.find("rates").closest("table").hidden = rows.length === 0;
  }

  say(text, place = "said") {
    this.find(place).textContent = text;
  }

  /** Keep everything shown in the address. */
  keep() {
    this.state.step = Math.round(this.clock.time);
    keepAddress(this.state);
  }
}
