// The second tab: a person decides, once a second, and sees the angle of their own driving.

import { signed } from "./bars.js";
import { Curve } from "./curve.js";
import { demonstrationsFile } from "./demonstrations.js";
import { meanOf } from "./episodes.js";
import { filmOf, filmOfActions, outcomeOf, sceneAt } from "./film.js";
import { agreements, likeliest } from "./likeness.js";
import { Stage } from "./scene.js";
import { Transport } from "./transport.js";

const ENOUGH = 5; // episodes from which on an angle is shown
const KEPT = "socialiq-driven"; // where the browser keeps them
const BESIDE = [0, 45]; // degrees at which the same traffic is shown after an episode
const PLACES = [0, 2]; // of their colours
const [SLOWER, IDLE, FASTER] = [0, 1, 2];
const PEDALS = ["slower", "idle", "faster"]; // by their number as a decision

/** Return what this browser keeps of earlier visits: seeds and decisions; nothing where it keeps nothing. */
function keptEpisodes() {
  try {
    const kept = JSON.parse(window.localStorage.getItem(KEPT) ?? "[]");
    const right = ({ seed, actions }) => Number.isSafeInteger(seed) && seed >= 0 && Array.isArray(actions) && actions.length > 0 && actions.every((action) => [SLOWER, IDLE, FASTER].includes(action));
    return Array.isArray(kept) ? kept.filter(right) : [];
  } catch {
    return [];
  }
}

export class Driving {
  constructor(parts, state) {
    Object.assign(this, parts);
    this.state = state;
    this.find = (name) => document.getElementById(name);
    this.stage = new Stage(this.find("road"), this.layout);
    this.plot = new Curve(this.find("own-curve"), this.curve);
    this.films = keptEpisodes().map(({ seed, actions }) => filmOfActions(this.recorder, seed, actions)).filter(({ ending }) => ending !== this.layout.endings.none);
    this.beside = BESIDE.map((_, number) => ({ stage: new Stage(this.find(`beside-${number}`), this.layout), said: this.find(`beside-said-${number}`), film: null }));
    this.replay = new Transport(this.layout.frames / this.layout.decision_seconds, () => this.showBeside());
    this.networks = null;
    this.action = IDLE;
    this.clock = new Transport(this.layout.frames / this.layout.decision_seconds, () => this.moved());
    PEDALS.forEach((name, action) => this.find(name).addEventListener("click", () => this.choose(action)));
    this.find("start").addEventListener("click", () => this.start());
    this.find("download").addEventListener("click", () => this.download());
    this.find("forget").addEventListener("click", () => this.forget());
    this.find("own-seed").addEventListener("change", (event) => this.typeSeed(event.target));
    this.film = null;
    this.next();
    if (this.films.length) this.account();
  }

  /** Prepare the next seed: the chosen one, then those after it. */
  next() {
    if (this.base !== this.state.seed) Object.assign(this, { base: this.state.seed, driven: 0 });
    this.film = this.recorder.begin(this.base + this.driven);
    this.over = this.finished = false;
    this.clock.time = 0;
    this.clock.load(0);
    this.find("own-seed").value = this.film.seed;
    this.choose(IDLE);
  }

  typeSeed(field) {
    const seed = Number(field.value);
    const right = field.value.trim() !== "" && Number.isSafeInteger(seed) && seed >= 0;
    if (right) {
      this.pause();
      this.state.seed = seed;
      this.base = undefined;
      this.next();
    } else {
      field.value = this.film.seed;
      this.find("next-decision").textContent = "A seed is a whole number from 0 on.";
    }
  }

  start() {
    if (this.clock.playing) {
      this.pause();
      return;
    }
    if (this.finished) this.next();
    if (this.clock.time >= this.clock.end) this.decide();
    this.clock.play();
  }

  pause() {
    if (this.clock.playing) this.clock.pause();
    if (this.replay.playing) this.replay.pause();
  }

  /** Take a press: for this second in its first half, and else for the next one. */
  choose(action) {
    if (this.early) this.decideAgain(action);
    else this.action = action;
    this.show();
  }

  /** Whether the second under way is in its first half. */
  get early() {
    return !this.finished && this.clock.end > 0 && 2 * (this.clock.end - this.clock.time) > this.layout.frames;
  }

  /** Take another decision in the place of the last one, whose second is under way. */
  decideAgain(action) {
    const actions = this.film.decisions.map((decision) => decision.action);
    this.film = filmOfActions(this.recorder, this.film.seed, [...actions.slice(0, -1), action]);
    this.over = this.film.ending !== this.layout.endings.none;
    this.clock.load(this.film.frames.length - 1);
  }

  key(event) {
    const actions = { ArrowDown: SLOWER, ArrowLeft: SLOWER, ArrowUp: FASTER, ArrowRight: FASTER, " ": null };
    if (!(event.key in actions) || (event.key === " " && event.target.closest("button"))) return false;
    if (event.key === " ") this.start();
    else this.choose(actions[event.key]);
    return true;
  }

  /** Take the chosen decision; the clock then runs through its second. */
  decide() {
    this.over = !this.recorder.decide(this.action);
    this.clock.load(this.film.frames.length - 1);
    this.action = IDLE;
    this.show();
  }

  moved() {
    const { clock } = this;
    if (clock.time >= clock.end && clock.end > 0 && !clock.playing) {
      if (this.over) this.finish();
      else {
        this.decide();
        clock.playing = true;
      }
    }
    this.show();
  }

  finish() {
    if (this.finished) return;
    this.finished = true;
    this.films.push(this.film);
    this.driven += 1;
    const [env, social] = this.sums(this.film);
    const ended = outcomeOf(this.film, this.layout).replace(/^is/, "are").replace(/^(arrive|collide)s/, "$1");
    this.find("own").textContent = `You ${ended}: own progress ${signed(env)}, effect on others ${signed(social)}.`;
    this.account();
    this.keep();
    this.compare();
  }

  /** Keep the episodes for the next visit, where the browser allows it. */
  keep() {
    const kept = this.films.map(({ seed, decisions }) => ({ seed, actions: decisions.map(({ action }) => action) }));
    try {
      window.localStorage.setItem(KEPT, JSON.stringify(kept));
    } catch {
      // a private window: they last as long as the page
    }
  }

  forget() {
    this.films = [];
    this.keep();
    this.find("own").textContent = "Drive an episode to see your rewards.";
    this.find("own-angle").textContent = `${ENOUGH} more to see which angle you drive most like.`;
    for (const name of ["download", "forget"]) this.find(name).disabled = true;
    this.plot.show([], []);
  }

  /** Show the seed of the last episode as the dial drives it. */
  compare() {
    const [low, high] = this.range;
    this.beside.forEach((scene, number) => {
      const angle = Math.min(Math.max(BESIDE[number], low), high);
      scene.film = filmOf(this.recorder, this.dial.at(angle), this.film.seed);
      scene.said.textContent = outcomeOf(scene.film, this.layout);
    });
    this.find("beside").hidden = false;
    this.replay.time = 0;
    this.replay.load(Math.max(...this.beside.map(({ film }) => film.frames.length - 1)));
    this.replay.play();
  }

  showBeside() {
    const colours = this.colours();
    this.beside.forEach(({ stage, film }, number) => {
      if (!film) return;
      stage.fit(colours);
      stage.draw(sceneAt(film, this.replay.time).vehicles, { letter: "", colour: colours.twins[PLACES[number]], braking: new Set(), near: false }, []);
    });
  }

  sums(film) {
    return [0, 1].map((place) => film.decisions.reduce((sum, one) => sum + one.rewards[place], 0));
  }

  account() {
    const pairs = this.films.map((film) => this.sums(film));
    const left = ENOUGH - pairs.length;
    for (const name of ["download", "forget"]) this.find(name).disabled = false;
    this.find("own-angle").textContent = left > 0 ? `${left} more to see which angle you drive most like.` : this.likeness();
    const [env, social] = [0, 1].map((place) => meanOf(pairs.map((pair) => pair[place])));
    const measured = pairs.length > 1 ? { env, social } : { env: [env[0], env[0], env[0]], social: [social[0], social[0], social[0]] };
    this.plot.show([{ place: 1, letter: "you" }], [measured]);
  }

  /** Which angle of the dial takes most of your decisions, in words. */
  likeness() {
    const [first, last] = this.range;
    const angles = Array.from({ length: last - first + 1 }, (_, number) => first + number);
    this.networks ??= angles.map((angle) => this.dial.at(angle));
    const decisions = this.films.reduce((sum, film) => sum + film.decisions.length, 0);
    const { place, low, high, share } = likeliest(agreements(this.films, this.networks), decisions);
    return `You drove most like the dial at ${angles[place]}° (from ${angles[low]}° to ${angles[high]}°): it takes ${Math.round(100 * share)} % of your ${decisions} decisions, too.`;
  }

  show() {
    if (!this.film || this.find("drive").hidden) return;
    if (!this.clock.playing && this.clock.end === 0 && this.base !== this.state.seed) this.next();
    const colours = this.colours();
    this.stage.fit(colours);
    const now = this.film.decisions[this.film.decisions.length - 1];
    const near = Boolean(now && now.signals[this.layout.env_signals] > 0);
    const twin = { letter: "", colour: colours.twins[1], braking: now?.braking ?? new Set(), near };
    const { vehicles } = sceneAt(this.film, this.clock.time);
    this.stage.draw(vehicles, twin, []);
    this.dashboard(vehicles.find((vehicle) => vehicle.ego));
    this.find("start").textContent = this.clock.playing ? "Pause" : this.finished ? "Next episode" : "Drive";
  }

  /** Speed, and what the next decision will be and when: a press is confirmed at once. */
  dashboard(ego) {
    const speed = `${Math.round(3.6 * (ego?.speed ?? 0))} km/h`;
    if (this.find("own-speed").textContent !== speed) this.find("own-speed").textContent = speed;
    const left = Math.max(this.clock.end - this.clock.time, 0) / this.clock.rate;
    const taken = this.early ? this.film.decisions[this.film.decisions.length - 1].action : this.action;
    PEDALS.forEach((name, number) => this.find(name).setAttribute("aria-pressed", String(number === taken)));
    const at = this.early ? "now" : this.clock.end > 0 ? `in ${left.toFixed(1)} s` : "first decision";
    this.find("next-decision").textContent = this.finished ? "" : `${at}: ${["slower", "keep", "faster"][taken]}`;
  }

  download() {
    const bytes = demonstrationsFile(this.films, this.layout);
    const place = URL.createObjectURL(new Blob([bytes], { type: "application/octet-stream" }));
    const link = document.createElement("a");
    link.href = place;
    link.download = "driven.safetensors";
    link.click();
    window.setTimeout(() => URL.revokeObjectURL(place), 1000);
  }
}
