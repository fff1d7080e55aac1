// The second tab: a person decides, once a second, and sees the angle of their own driving.

import { signed } from "./bars.js";
import { Curve } from "./curve.js";
import { demonstrationsFile } from "./demonstrations.js";
import { meanOf } from "./episodes.js";
import { outcomeOf, sceneAt } from "./film.js";
import { Stage } from "./scene.js";
import { Transport } from "./transport.js";

const ENOUGH = 5; // episodes from which on an angle is shown
const RESAMPLES = 2000;
const [SLOWER, IDLE, FASTER] = [0, 1, 2];

/** Return the angle of mean rewards in degrees. */
export function angleOf(env, social) {
  return (Math.atan2(social, env) * 180) / Math.PI;
}

/** Return the angle of the means of pairs with a 95 % percentile bootstrap: `[angle, low, high]`. */
export function angleInterval(pairs) {
  let word = 1; // a fixed stream (Lehmer 1951, by Park and Miller): the same episodes, the same interval
  const draw = (below) => ((word = (word * 48271) % 2147483647) % below);
  const mean = (chosen, place) => chosen.reduce((sum, pair) => sum + pair[place], 0) / chosen.length;
  const own = angleOf(mean(pairs, 0), mean(pairs, 1));
  const apart = Array.from({ length: RESAMPLES }, () => {
    const chosen = pairs.map(() => pairs[draw(pairs.length)]);
    return ((angleOf(mean(chosen, 0), mean(chosen, 1)) - own + 540) % 360) - 180;
  }).sort((one, other) => one - other);
  return [own, own + apart[Math.floor(0.025 * RESAMPLES)], own + apart[Math.ceil(0.975 * RESAMPLES) - 1]];
}

export class Driving {
  constructor(parts, state) {
    Object.assign(this, parts);
    this.state = state;
    this.find = (name) => document.getElementById(name);
    this.stage = new Stage(this.find("road"), this.layout);
    this.plot = new Curve(this.find("own-curve"), this.curve);
    this.films = [];
    this.action = IDLE;
    this.clock = new Transport(this.layout.frames / this.layout.decision_seconds, () => this.moved());
    [["slower", SLOWER], ["idle", IDLE], ["faster", FASTER]].forEach(([name, action]) => {
      this.find(name).addEventListener("click", () => this.choose(action));
    });
    this.find("start").addEventListener("click", () => this.start());
    this.find("download").addEventListener("click", () => this.download());
    this.film = null;
    this.next();
  }

  /** Prepare the next seed. */
  next() {
    this.film = this.recorder.begin(this.state.seed + this.films.length);
    this.over = false;
    this.clock.time = 0;
    this.clock.load(0);
    this.choose(IDLE);
  }

  start() {
    if (this.clock.playing) {
      this.pause();
      return;
    }
    if (this.over) this.next();
    if (this.clock.time >= this.clock.end) this.decide();
    this.clock.play();
  }

  pause() {
    if (this.clock.playing) this.clock.pause();
  }

  choose(action) {
    this.action = action;
    ["slower", "idle", "faster"].forEach((name, number) => this.find(name).setAttribute("aria-pressed", String(number === action)));
    this.show();
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
    this.choose(IDLE);
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
    if (this.films.includes(this.film)) return;
    this.films.push(this.film);
    const [env, social] = this.sums(this.film);
    const ended = outcomeOf(this.film, this.layout).replace(/^is/, "are").replace(/^(arrive|collide)s/, "$1");
    this.find("own").textContent = `You ${ended}: own progress ${signed(env)}, effect on others ${signed(social)}.`;
    this.account();
  }

  sums(film) {
    return [0, 1].map((place) => film.decisions.reduce((sum, one) => sum + one.rewards[place], 0));
  }

  account() {
    const pairs = this.films.map((film) => this.sums(film));
    const left = ENOUGH - pairs.length;
    this.find("download").disabled = false;
    if (left > 0) this.find("own-angle").textContent = `${left} more to see your angle.`;
    else {
      const [angle, low, high] = angleInterval(pairs).map((one) => `${one.toFixed(0).replace("-", "−")}°`);
      this.find("own-angle").textContent = `Your angle shows ${angle} (${low} to ${high}, ${pairs.length} episodes).`;
    }
    const [env, social] = [0, 1].map((place) => meanOf(pairs.map((pair) => pair[place])));
    const found = pairs.length > 1 ? { env, social } : { env: [env[0], env[0], env[0]], social: [social[0], social[0], social[0]] };
    this.plot.show([{ place: 1, letter: "you", angle: Math.round(angleOf(env[0], social[0])) }], [found]);
  }

  show() {
    if (!this.film || this.find("drive").hidden) return;
    const colours = this.colours();
    this.stage.fit(colours);
    const now = this.film.decisions[this.film.decisions.length - 1];
    const near = Boolean(now && now.signals[this.layout.env_signals] > 0);
    const twin = { letter: "", colour: colours.twins[1], braking: now?.braking ?? new Set(), near };
    this.stage.draw(sceneAt(this.film, this.clock.time).vehicles, twin, []);
    this.find("start").textContent = this.clock.playing ? "Pause" : this.over ? "Next episode" : "Drive";
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
