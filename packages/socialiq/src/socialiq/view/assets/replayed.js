// Episodes of a file: driven again from their seeds, or drawn from what was observed.

import { Bars, element, signed } from "../../page/assets/bars.js";
import { Core } from "../../page/assets/core.js";
import { Curve } from "../../page/assets/curve.js";
import { Recorder, decisionAt, outcomeOf, sceneAt, sumsOf } from "../../page/assets/film.js";
import { Stage } from "../../page/assets/scene.js";
import { partOf } from "./connection.js";
import { Controls, stateOf } from "./controls.js";

const CLOSE = 1e-4; // of an observation, whose numbers are at most 1: 1 cm
const ACTING = "slower keep faster".split(" ");

export class Replayed {
  /**
   * @param {object} parts `{ module, layout, curve, colours, complain }` of the page.
   * @param {object} shown `{ count, modes, notable, curve }`; `curve`: whether rewards are on the scale of the dial's curve.
   */
  constructor(parts, shown) {
    Object.assign(this, parts, { shown });
    this.find = (name) => document.getElementById(name);
    this.state = stateOf({ episode: [0, 0, shown.count - 1], step: [0, 0, 1e5], speed: [1, 0.25, 4, 0.25] });
    this.recorder = new Recorder(new Core(this.module, this.layout, 1, true));
    this.stage = new Stage(this.find("road"), this.layout);
    this.bars = new Bars(this.find("bars"), this.layout);
    this.bars.build([{ letter: "ego", place: 0 }]);
    this.controls = new Controls(this.layout.frames / this.layout.decision_seconds, this.layout.frames, this.state, () => this.show());
    this.asked = 0;
    this.listen();
    this.modes();
    this.notable();
    this.to(this.state.episode, this.state.step === 0);
  }

  listen() {
    const on = (name, event, act) => this.find(name).addEventListener(event, act);
    on("next", "click", () => this.to(this.state.episode + 1, true));
    on("before", "click", () => this.to(this.state.episode - 1, true));
    on("episode", "change", (event) => this.typed(event.target));
    new ResizeObserver(() => this.show()).observe(document.querySelector("main"));
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.show());
  }

  typed(field) {
    const number = Number(field.value);
    const right = field.value.trim() !== "" && Number.isInteger(number) && number >= 0 && number < this.shown.count;
    this.find("said").textContent = right ? "" : `An episode is a whole number from 0 to ${this.shown.count - 1}.`;
    if (right) this.to(number, true);
    else field.value = this.state.episode;
  }

  /** Fetch and show an episode; the file is a ring. */
  async to(number, rewound) {
    const asked = (this.asked += 1);
    const episode = (number + this.shown.count) % this.shown.count;
    try {
      const part = await partOf(episode);
      if (asked !== this.asked) return;
      this.state.episode = episode;
      this.take(part, rewound);
      document.documentElement.dataset.ready = "yes";
    } catch (error) {
      this.complain(error.message);
    }
  }

  take(part, rewound) {
    const again = part.seed === null ? null : this.again(part);
    this.part = part;
    this.rewards = part.rewards ?? again.film.decisions.map((one) => one.rewards);
    this.whole = Boolean(again?.same);
    this.film = this.whole ? again.film : drawn(part, this.layout);
    this.stretch = this.whole ? 1 : this.layout.frames;
    this.find("episode").value = this.state.episode;
    this.find("mode").textContent = part.mode;
    this.find("outcome").textContent = outcomeOf(this.film, this.layout);
    this.find("how").textContent = this.how(again);
    this.find("bars").hidden = !this.whole;
    this.listed();
    this.controls.load((this.film.frames.length - 1) * this.stretch, rewound);
  }

  /** Return where the film comes from, and how near it is to what was recorded. */
  how(again) {
    const { seed, totals, ending, actions } = this.part;
    if (!totals) return this.whole ? sameWords(seed, again.apart) : drawnWords(seed);
    const { film } = again;
    const driven = `Driven again from seed ${seed} with the decisions of the audit`;
    if (film.ending !== ending || film.decisions.length !== actions.length) return `${driven}: here it ${outcomeOf(film, this.layout)}, unlike in the report.`;
    return again.apart < 1e-9 ? `${driven}: the rewards of the report, to 1e-9.` : `${driven}: rewards that differ from the report's by at most ${again.apart.toPrecision(1)}.`;
  }

  /** Drive the episode again: its film, whether what was observed is the same, and how far rewards are apart. */
  again({ seed, actions, observations, rewards, totals }) {
    const film = this.recorder.begin(seed);
    const driven = actions.every((action, step) => this.recorder.decide(action) || step === actions.length - 1);
    if (totals) {
      const { env, social } = sumsOf(film, film.decisions.length, this.layout.signals.length);
      return { film, same: true, apart: Math.max(Math.abs(env - totals[0]), Math.abs(social - totals[1])) };
    }
    if (!driven) return null;
    const same = observations.every((row, step) => film.decisions[step].before.every((value, place) => Math.abs(value - row[place]) < CLOSE));
    const apart = Math.max(...rewards.flatMap((pair, step) => pair.map((value, place) => Math.abs(value - film.decisions[step].rewards[place]))));
    return { film, same, apart };
  }

  /** Each decision with its rewards. */
  listed() {
    const rows = this.rewards.map(([env, social], step) => {
      const action = this.part.actions[step];
      return element("tr", {}, element("th", { scope: "row", textContent: `${this.part.steps[step]} s` }), ...[ACTING[action], signed(env), signed(social)].map((text) => element("td", { textContent: text })));
    });
    this.find("decisions").replaceChildren(...rows);
  }

  show() {
    if (!this.film) return;
    const { clock } = this.controls;
    const { film, layout } = this;
    const colours = this.colours();
    this.stage.fit(colours);
    const at = decisionAt(film, clock.time, layout.frames);
    const now = clock.time > 0 && this.whole ? film.decisions[at] : undefined;
    const near = Boolean(now && now.signals[layout.env_signals] > 0);
    this.stage.draw(sceneAt(film, clock.time / this.stretch).vehicles, { letter: "", colour: colours.twins[0], braking: now?.braking ?? new Set(), near }, []);
    const made = Math.min(Math.ceil(clock.time / layout.frames), film.decisions.length);
    [...this.find("decisions").children].forEach((row, step) => row.classList.toggle("now", step === made - 1));
    if (this.whole) this.bars.show([sumsOf(film, made, layout.signals.length)]);
    const sum = (place) => signed(this.rewards.slice(0, made).reduce((total, pair) => total + pair[place], 0));
    this.find("sums").textContent = `own progress ${sum(0)}, effect on others ${sum(1)}`;
  }

  /** Means of each mode, in a table and on the dial's curve. */
  modes() {
    const rows = this.shown.modes.map(({ mode, episodes, env, social, angle, arrival, collision }, place) => {
      const badge = place < 3 ? [element("span", { className: `badge twin-${place}`, textContent: "ABC"[place] }), " "] : [];
      const texts = [episodes, signed(env[0]), signed(social[0]), `${angle.toFixed(0).replace("-", "−")}°`, percent(arrival), percent(collision)];
      return element("tr", {}, element("th", { scope: "row" }, ...badge, mode), ...texts.map((text) => element("td", { textContent: text })));
    });
    this.find("modes").replaceChildren(...rows);
    this.find("curve").toggleAttribute("hidden", !this.shown.curve);
    const plot = new Curve(this.find("curve"), this.curve);
    const first = this.shown.modes.slice(0, 3);
    plot.show(first.map(({ angle }, place) => ({ letter: "ABC"[place], place, angle: Math.round(angle) })), first);
  }

  notable() {
    const buttons = this.shown.notable.map(({ episode, why }) => {
      const button = element("button", { type: "button", className: "plain" }, `episode ${episode}`, element("small", { textContent: why }));
      button.addEventListener("click", () => this.to(episode, true));
      return element("li", {}, button);
    });
    this.find("found").replaceChildren(...buttons);
  }
}

function percent(share) {
  return `${(100 * share).toFixed(0)} %`;
}

function sameWords(seed, apart) {
  const rewards = apart < 1e-9 ? "the same rewards" : `rewards that differ by at most ${apart.toPrecision(1)} in a decision`;
  return `Driven again from seed ${seed} with the recorded decisions: the same observations, ${rewards}.`;
}

function drawnWords(seed) {
  const why = seed === null ? "The file gives no seed of this episode" : `Seed ${seed} gives other observations than the file's`;
  return `${why}, so it is drawn from what the ego observed each second: other vehicles may be missing.`;
}

/** Return a film of the scenes that were observed, one picture for each decision. */
function drawn({ scenes, actions, rewards, ending }, layout) {
  const frames = scenes.map((vehicles, number) => ({
    count: vehicles.length,
    agent: Int8Array.from(vehicles, (_, slot) => (slot === 0 ? 0 : -1)),
    identity: Int32Array.from(vehicles, (one) => one[4]),
    yielding: new Uint8Array(vehicles.length),
    crashed: Uint8Array.from(vehicles, (_, slot) => Number(slot === 0 && number === scenes.length - 1 && ending === layout.endings.collision)),
    numbers: Float64Array.from(vehicles.flatMap(([x, y, heading, speed]) => [x, y, heading, speed, 0])),
  }));
  const decisions = actions.map((action, step) => ({ action, rewards: rewards[step], signals: [], braking: new Set() }));
  return { frames, decisions, ending };
}
