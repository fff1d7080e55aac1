// Recorded traffic on its lanes: conflicts, who yields to whom, and the rewards of the drivers.

import { element, signed } from "../../page/assets/bars.js";
import { partOf } from "./connection.js";
import { Controls, stateOf } from "./controls.js";
import { Ground, boxOf } from "./ground.js";

const AROUND = 38; // m around a conflict that are shown
const EARLY = 4; // s before a conflict's first entry at which it is shown
const DRIVEN = { arrival: "arrives", collision: "collides", timeout: "out of time" };
const ENDINGS = { arrival: "leaves", collision: "collides", timeout: "out of view" };

/** Order of a conflict's tracks: who enters first, and who yields; null if neither arrives. */
export function orderOf({ tracks, ego_first: first }) {
  if (first === null) return null;
  return first ? tracks : [tracks[1], tracks[0]];
}

/** Return the largest deceleration that the one who yields needed, m/s², or "unavoidable". */
export function neededBy({ ego_first: first, required_deceleration: own, other_required_deceleration: other }) {
  return first ? other : own;
}

export class Traffic {
  /**
   * @param {object} parts `{ colours, complain }` of the page.
   * @param {object} shown Data of `socialiq_recordings.view`.
   */
  constructor(parts, shown) {
    Object.assign(this, parts, { shown, loaded: new Map() });
    this.find = (name) => document.getElementById(name);
    const { conflicts, drivers, frames, dt, users } = shown;
    this.state = stateOf({
      conflict: [conflicts.length ? 0 : -1, -1, conflicts.length - 1], driver: [shown.driven ? drivers[0].track : -1, -1, users.length - 1], step: [-1, 0, frames - 1], speed: [1, 0.25, 4, 0.25],
    });
    this.ground = new Ground(this.find("road"), shown.lanes);
    const corners = shown.lanes.flatMap(({ left, right }) => [...left, ...right]);
    this.box = corners.length ? boxOf(corners) : null;
    this.rewards = new Map(drivers.map((one) => [one.track, one]));
    this.lists();
    const asked = this.state.step;
    this.state.step = Math.max(asked, 0);
    this.controls = new Controls(1 / dt, Math.max(Math.round(1 / dt), 1), this.state, () => this.show());
    this.find("far").addEventListener("click", () => this.choose(-1, -1));
    new ResizeObserver(() => this.show()).observe(document.querySelector("main"));
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.show());
    this.start(asked);
  }

  /** Fetch where the traffic begins, then the rest, in order. */
  async start(asked) {
    try {
      await this.fetch(0);
      this.box ??= boxOf(this.loaded.get(0).flatMap((frame) => frame.map(([, x, y]) => [x, y])));
      const { conflict } = this.state;
      if (asked < 0 && conflict >= 0) this.controls.clock.time = this.beginning(this.shown.conflicts[conflict]);
      this.controls.load(this.shown.frames - 1, false);
      for (let part = 1; part < this.shown.count; part += 1) await this.fetch(part);
      this.controls.show();
      document.documentElement.dataset.ready = "yes";
    } catch (error) {
      this.complain(error.message);
    }
  }

  async fetch(number) {
    this.loaded.set(number, (await partOf(number)).frames);
    this.find("said").textContent = number + 1 < this.shown.count ? `loading: part ${number + 1} of ${this.shown.count}` : "";
  }

  frame(number) {
    const { chunk } = this.shown;
    return this.loaded.get(Math.floor(number / chunk))?.[number % chunk] ?? [];
  }

  /** Return the road users at a time in frames, between two of them on the straight line. */
  usersAt(time) {
    const at = Math.floor(time);
    const next = new Map(this.frame(at + 1).map((row) => [row[0], row]));
    return this.frame(at).map((row) => {
      const [track, x, y, heading, speed] = row;
      const later = next.get(track) ?? row;
      const share = time - at;
      const turn = Math.atan2(Math.sin(later[3] - heading), Math.cos(later[3] - heading));
      return {
        track, ...this.shown.users[track],
        x: x + share * (later[1] - x), y: y + share * (later[2] - y), heading: heading + share * turn,
        speed: speed + share * (later[4] - speed), acceleration: (later[4] - speed) / this.shown.dt,
      };
    });
  }

  /** Return the frame from which a conflict is worth seeing. */
  beginning({ times, seen }) {
    const entries = [times[0], times[2]].filter((time) => time !== null);
    const wanted = (entries.length ? Math.min(...entries) : seen[0] ?? 0) - EARLY / this.shown.dt;
    return Math.min(Math.max(Math.round(wanted), seen[0] ?? 0, 0), this.shown.frames - 1);
  }

  choose(conflict, driver) {
    Object.assign(this.state, { conflict, driver });
    const chosen = this.shown.conflicts[conflict];
    this.controls.clock.playing = false;
    if (chosen) this.controls.clock.time = this.beginning(chosen);
    else if (driver >= 0) [this.controls.clock.time] = this.rewards.get(driver).frames;
    this.controls.show();
  }

  name(track) {
    return String(this.shown.users[track].name);
  }

  lists() {
    const { conflicts, drivers } = this.shown;
    this.find("none").hidden = conflicts.length > 0;
    if (this.shown.driven) {
      for (const name of ["why", "meanings", "far"]) this.find(name).hidden = true;
      this.find("listed").textContent = "Episodes";
      this.find("who").textContent = "seed";
    }
    this.find("conflicts").replaceChildren(...conflicts.map((one, number) => this.row(this.words(one), () => this.choose(number, -1))));
    const rows = drivers.map((one) => {
      const [env, social] = [0, 1].map((place) => signed(one.rewards.reduce((sum, pair) => sum + pair[place], 0)));
      return this.row([this.name(one.track), one.rewards.length, env, social, (this.shown.driven ? DRIVEN : ENDINGS)[one.ending] ?? one.ending], () => this.choose(-1, one.track));
    });
    this.find("drivers").replaceChildren(...rows);
  }

  words(one) {
    const order = orderOf(one);
    const [first, second] = order ?? one.tracks;
    const number = (value) => (typeof value === "number" ? value.toFixed(1) : value ?? "-");
    return [this.name(second), this.name(first), order ? `${one.kind}${one.complete ? "" : ", projected"}` : `${one.kind}, neither arrives`, `${number(one.pet)}${one.pet === null ? "" : " s"}`, number(neededBy(one))];
  }

  /** A row of a table whose first cell is a button. */
  row([head, ...cells], act) {
    const button = element("button", { type: "button", className: "plain row", textContent: head });
    button.addEventListener("click", act);
    return element("tr", {}, element("th", { scope: "row" }, button), ...cells.map((text) => element("td", { textContent: text })));
  }

  show() {
    if (!this.box || !this.controls) return;
    const { conflicts, dt } = this.shown;
    const { time } = this.controls.clock;
    const chosen = conflicts[this.state.conflict];
    const users = this.usersAt(time);
    if (this.shown.driven) this.state.driver = this.shown.drivers.findLast(({ frames }) => frames[0] <= time).track;
    const colours = this.colours();
    this.ground.begin(this.viewed(chosen, users), colours);
    const now = conflicts.filter(({ seen }) => seen.length && seen[0] <= time && time <= seen[1]);
    for (const one of now) if (one !== chosen) this.ground.area(one.outline, false);
    if (chosen) this.ground.area(chosen.outline, true);
    const order = chosen ? orderOf(chosen) ?? chosen.tracks : [this.state.driver, -1];
    for (const one of users) {
      const place = order.indexOf(one.track);
      this.ground.user(one, place < 0 ? colours.other : colours.twins[place], place < 0 ? "" : this.name(one.track), this.waits(now, one.track, time));
    }
    this.labels(chosen, order, time, dt);
  }

  /** Whether a vehicle yields now: it will be the second in an area that the first has not left. */
  waits(now, track, time) {
    return now.some((one) => {
      const order = orderOf(one);
      if (!order || order[1] !== track) return false;
      const [enters, leaves] = one.ego_first ? [one.times[2], one.times[1]] : [one.times[0], one.times[3]];
      return (enters === null || time < enters) && (leaves === null || time < leaves);
    });
  }

  /** Return what is shown: around the conflict, around the vehicle, or the whole road. */
  viewed(chosen, users) {
    const around = ([left, low, right, high], more) => [left - more, low - more, right + more, high + more];
    if (chosen) return around(boxOf(chosen.outline), AROUND);
    if (this.shown.around === false) return this.box;
    const followed = users.find(({ track }) => track === this.state.driver);
    if (followed) return around(boxOf([[followed.x, followed.y]]), AROUND);
    return this.box;
  }

  labels(chosen, order, time, dt) {
    const { driver, conflict } = this.state;
    const rows = [[this.find("conflicts"), conflict], [this.find("drivers"), this.shown.drivers.findIndex(({ track }) => track === driver)]];
    for (const [list, place] of rows) [...list.children].forEach((row, number) => row.classList.toggle("now", number === place));
    this.find("which").textContent = chosen ? this.sentence(chosen) : driver >= 0 ? `${this.shown.driven ? "Episode of" : "Vehicle"} ${this.name(driver)}` : "Whole road";
    this.find("outcome").textContent = `${(time * dt).toFixed(1)} s`;
    const words = order.filter((track) => this.rewards.has(track)).map((track) => `${this.name(track)}: own progress ${this.sum(track, 0, time)}, effect on others ${this.sum(track, 1, time)}`);
    this.find("sums").textContent = words.join("; ") || (chosen ? "These vehicles make no episode." : "");
  }

  sentence(conflict) {
    const order = orderOf(conflict);
    const [first, second] = (order ?? conflict.tracks).map((track) => this.name(track));
    if (!order) return `${first} and ${second}: neither arrives`;
    return `${second} yields to ${first}${conflict.pet === null ? "" : `, PET ${conflict.pet.toFixed(1)} s`}`;
  }

  /** Return a reward's sum over the decisions that have begun. */
  sum(track, place, time) {
    const { frames, rewards } = this.rewards.get(track);
    return signed(rewards.reduce((sum, pair, step) => sum + (frames[step] < time ? pair[place] : 0), 0));
  }
}
