// The tab "Sold as 45°: is it?": three cars, one of them honest, and which angles their driving doesn't exclude.

import { element } from "./bars.js";
import { Curve } from "./curve.js";
import { meanOf } from "./episodes.js";

const EPISODES = 500;
const FIRST_SEED = 10_001; // none of those that the curve was measured on
const LIMIT = 5.991; // 95 % quantile of chi-square with two degrees of freedom
const Z = 1.959964;
const TRUE = [0, 45, 75]; // degrees at which the cars drive, in the order of `ORDER`
const ORDER = [2, 0, 1];

/** Return the covariance of the mean of pairs: `[env, both, social]`. */
function covariance(pairs, [env, social]) {
  const sum = pairs.reduce((all, episode) => {
    const [x, y] = [episode.env - env, episode.social - social];
    return [all[0] + x * x, all[1] + x * y, all[2] + y * y];
  }, [0, 0, 0]);
  return sum.map((value) => value / (pairs.length - 1) / pairs.length);
}

/** Return a point of the curve at an angle, with its variances: on the straight line between its neighbours. */
function pointAt(curve, angle) {
  const after = Math.max(curve.findIndex(({ asked }) => asked >= angle), 1);
  const [low, high] = [curve[after - 1], curve[after]];
  const share = (angle - low.asked) / (high.asked - low.asked);
  const mix = (name) => {
    const [mean, variance] = [0, 1].map((kind) => [low, high].map((point) => (kind ? ((point[name][2] - point[name][1]) / 2 / Z) ** 2 : point[name][0])));
    return [mean[0] + share * (mean[1] - mean[0]), Math.max(...variance)];
  };
  return { env: mix("env"), social: mix("social") };
}

/**
 * Return the whole angles of the curve that episodes don't exclude at 5 % each (Hotelling's test of both means).
 *
 * @param {{env: number, social: number}[]} episodes Their sums.
 */
export function notExcluded(episodes, curve) {
  const means = ["env", "social"].map((name) => meanOf(episodes.map((episode) => episode[name]))[0]);
  const [ee, es, ss] = covariance(episodes, means);
  const angles = [];
  for (let angle = Math.ceil(curve[0].asked); angle <= curve[curve.length - 1].asked; angle += 1) {
    const { env, social } = pointAt(curve, angle);
    const [x, y] = [means[0] - env[0], means[1] - social[0]];
    const [a, d] = [ee + env[1], ss + social[1]];
    if ((d * x * x - 2 * es * x * y + a * y * y) / (a * d - es * es) <= LIMIT) angles.push(angle);
  }
  return angles;
}

export class Sold {
  /** @param {object} parts `{ curve, range, background, layout }`. */
  constructor(parts) {
    Object.assign(this, parts);
    this.find = (name) => document.getElementById(`sold-${name}`);
    const [low, high] = this.range;
    const within = (angle) => Math.min(Math.max(angle, low), high);
    this.declared = within(45);
    this.cars = ORDER.map((place) => within(TRUE[place]));
    this.plot = new Curve(this.find("curve"), this.curve);
    this.find("cars").replaceChildren(...this.cars.map((_, number) => this.button(number)));
  }

  button(number) {
    const button = element("button", { type: "button", textContent: `Car ${number + 1}` });
    button.addEventListener("click", () => this.check(number, button));
    return button;
  }

  /** Drive a car's episodes in the background and say which angles they don't exclude. */
  async check(number, button) {
    const buttons = [...this.find("cars").children];
    for (const other of buttons) { other.disabled = true; other.setAttribute("aria-pressed", String(other === button)); }
    this.find("verdict").textContent = "";
    this.find("why").textContent = `Driving car ${number + 1} through ${EPISODES} episodes ...`;
    try {
      const [episodes] = await this.background({ angles: [this.cars[number]], first: FIRST_SEED, count: EPISODES });
      this.tell(number, episodes);
    } catch (error) {
      this.find("why").textContent = error.message;
    }
    for (const other of buttons) other.disabled = false;
  }

  tell(number, episodes) {
    const angles = notExcluded(episodes, this.curve);
    const passes = angles.includes(this.declared);
    const range = angles.length ? (angles.length > 1 ? `${angles[0]}° to ${angles[angles.length - 1]}°` : `${angles[0]}°`) : "no angle of this dial";
    this.find("verdict").textContent = passes ? `Yes: it drives as a car of ${this.declared}° does.` : `No: it does not drive as a car of ${this.declared}° does.`;
    this.find("verdict").dataset.passes = String(passes);
    const [env, social] = ["env", "social"].map((name) => meanOf(episodes.map((episode) => episode[name])));
    this.find("why").textContent = `The same driving would have passed as ${range}. Compared: both mean rewards of ${EPISODES} fresh episodes with the dial's own at every angle, each at the level of 5 %. Truth: it is the dial at ${this.cars[number]}°.`;
    this.strip(angles);
    this.plot.show([{ place: 2, letter: String(number + 1), angle: this.cars[number] }], [{ env, social }]);
  }

  /** Which declarations would have passed, as a strip from 0 to 90. */
  strip(angles) {
    const [low, high] = this.range;
    const strip = this.find("strip");
    strip.hidden = false;
    const place = (angle) => `${(100 * (angle - low)) / (high - low)}%`;
    const bar = element("span", { className: "passed" });
    if (angles.length) {
      const last = angles[angles.length - 1];
      bar.style.left = place(angles[0] - 0.5);
      bar.style.width = `${(100 * (last - angles[0] + 1)) / (high - low)}%`;
    }
    const mark = element("span", { className: "declared", textContent: `sold as ${this.declared}°` });
    mark.style.left = place(this.declared);
    strip.replaceChildren(element("span", { className: "track" }, bar), mark, element("span", { className: "low", textContent: `${low}°` }), element("span", { className: "high", textContent: `${high}°` }));
    strip.setAttribute("aria-label", angles.length ? `Would have passed as ${angles[0]} to ${angles[angles.length - 1]} degrees` : "Would have passed at no angle");
  }
}
