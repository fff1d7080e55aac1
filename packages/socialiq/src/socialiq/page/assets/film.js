// Films: an episode with every sub-step of its vehicles, and what each decision was worth.

const COMING = new Set([1, 2]); // states of people who wait and who move (`worlds.road_users`)
const NUMBERS = ["x", "y", "heading", "speed", "acceleration"];

/** Drives one episode, decision by decision, and keeps it. */
export class Recorder {
  /** @param {Core} core A traced core with one row. */
  constructor(core) {
    this.core = core;
    const fields = (array) => ({
      numbers: NUMBERS.map((name) => core.field(array, name)),
      identity: core.field(array, "identity"),
      agent: core.field(array, "agent"),
      yielding: core.field(array, "yielding"),
      crashed: core.field(array, "crashed"),
    });
    const ofPeople = (array) => {
      const names = ["identity", "kind", "x", "y", "heading", "length", "width", "delay", "state", "hit"];
      return Object.fromEntries(names.map((name) => [name, core.field(array, name)]));
    };
    this.now = { ...fields("vehicles"), people: ofPeople("people") };
    this.traced = { ...fields("trace"), people: ofPeople("people_trace") };
    this.count = core.field("episodes", "vehicles");
  }

  /** Begin the episode of a seed. */
  begin(seed) {
    this.core.begin(0, seed);
    this.core.run();
    const { agents, endings } = this.core.layout;
    this.film = { seed, frames: [], decisions: [], ending: endings.none, endings: new Array(agents).fill(endings.none) };
    this.keep(this.now, 0, this.count(0));
    return this.film;
  }

  /** What the driver sees now; a view that the next decision overwrites. */
  get observation() {
    return this.core.observation(0);
  }

  /** Take a decision, an action for each agent; return false once the episode has ended. What is kept of it is the first agent's. */
  decide(...actions) {
    const { core, film } = this;
    const { layout, arrays } = core;
    const before = this.observation.slice();
    core.decide(0, ...actions);
    core.run();
    const count = Number(arrays.present[0]);
    for (let frame = 0; frame < layout.frames; frame += 1) this.keep(this.traced, frame, count);
    const { identity } = film.frames[film.frames.length - 1];
    film.decisions.push({
      action: actions[0], before, after: this.observation.slice(),
      rewards: [...arrays.rewards.subarray(0, 2)],
      signals: layout.weights.map((weight, number) => weight * arrays.signals[number]),
      braking: new Set(identity.filter((_, slot) => arrays.braking[slot])),
      contact: arrays.contact[0],
    });
    film.endings = [...arrays.ending];
    film.ending = film.endings[0];
    return film.endings.includes(layout.endings.none);
  }

  /** Keep the vehicles and people of a sub-step, by its number in the arrays. */
  keep(from, number, count) {
    const { capacity, persons, people } = this.core.layout;
    const first = number * capacity;
    const frame = {
      count, identity: new Int32Array(count), agent: new Int8Array(count), yielding: new Uint8Array(count),
      crashed: new Uint8Array(count), numbers: new Float64Array(count * NUMBERS.length),
    };
    for (let slot = 0; slot < count; slot += 1) {
      frame.identity[slot] = from.identity(first + slot);
      frame.agent[slot] = from.agent(first + slot);
      frame.yielding[slot] = from.yielding(first + slot);
      frame.crashed[slot] = from.crashed(first + slot);
      from.numbers.forEach((read, place) => (frame.numbers[slot * NUMBERS.length + place] = read(first + slot)));
    }
    if (people) this.keepPeople(frame, from.people, number * persons, people.classes);
    this.film.frames.push(frame);
  }

  /** Keep who waits or walks, or rides, and the seconds that all waited for the ego since the start. */
  keepPeople(frame, from, first, classes) {
    frame.people = [];
    frame.waited = classes.map(() => 0);
    for (let slot = first; slot < first + this.core.layout.persons; slot += 1) {
      frame.waited[from.kind(slot)] += from.delay(slot);
      if (!COMING.has(from.state(slot))) continue;
      const person = Object.fromEntries(["identity", "x", "y", "heading", "length", "width"].map((name) => [name, from[name](slot)]));
      frame.people.push({ ...person, crashed: Boolean(from.hit(slot)) });
    }
  }
}

/** Return the film of a seed driven by a network. */
export function filmOf(recorder, network, seed) {
  const film = recorder.begin(seed);
  const driver = network.of(seed);
  while (recorder.decide(driver.decide(recorder.observation, film.decisions.length)));
  return film;
}

/** Return the film of a seed in which these decisions are taken, as far as it goes. */
export function filmOfActions(recorder, seed, actions) {
  const film = recorder.begin(seed);
  for (const action of actions) if (!recorder.decide(action)) break;
  return film;
}

/** Return the sums of a film's first decisions: `{ env, social, signals }`. */
export function sumsOf(film, decisions, signals) {
  const sums = { env: 0, social: 0, signals: new Array(signals).fill(0) };
  for (const one of film.decisions.slice(0, decisions)) {
    sums.env += one.rewards[0];
    sums.social += one.rewards[1];
    one.signals.forEach((value, number) => (sums.signals[number] += value));
  }
  return sums;
}

/**
 * Return the vehicles at a time in sub-steps, between two of them on the straight line.
 *
 * @returns {{frame: number, people: object[], vehicles: object[]}} Each vehicle with x, y, heading, speed, acceleration, agent (-1: a driver), and flags.
 */
export function sceneAt(film, time) {
  const last = film.frames.length - 1;
  const at = Math.min(Math.floor(time), last);
  const share = at < last ? time - at : 0;
  const frame = film.frames[at];
  const next = film.frames[Math.min(at + 1, last)];
  const vehicles = [];
  for (let slot = 0; slot < frame.count; slot += 1) {
    const one = vehicleOf(frame, slot);
    const later = share > 0 ? next.identity.indexOf(one.identity) : -1;
    if (later >= 0) towards(one, vehicleOf(next, later), share);
    vehicles.push(one);
  }
  const people = (frame.people ?? []).map((one) => {
    const later = share > 0 && next.people.find(({ identity }) => identity === one.identity);
    return later ? { ...one, x: one.x + share * (later.x - one.x), y: one.y + share * (later.y - one.y) } : one;
  });
  return { vehicles, people, frame: at };
}

function vehicleOf(frame, slot) {
  const [x, y, heading, speed, acceleration] = frame.numbers.subarray(slot * NUMBERS.length);
  const { identity, agent, yielding, crashed } = frame;
  return {
    x, y, heading, speed, acceleration,
    identity: identity[slot], agent: agent[slot], ego: agent[slot] >= 0, yielding: Boolean(yielding[slot]), crashed: Boolean(crashed[slot]),
  };
}

function towards(one, other, share) {
  for (const name of ["x", "y", "speed"]) one[name] += share * (other[name] - one[name]);
  const turn = other.heading - one.heading;
  one.heading += share * Math.atan2(Math.sin(turn), Math.cos(turn));
}

/** Return the decision that is under way at a time in sub-steps, from 0; the last at the end. */
export function decisionAt(film, time, frames) {
  return Math.max(0, Math.min(Math.floor(time / frames), film.decisions.length - 1));
}

/** Return a short account of how a film ended. */
export function outcomeOf(film, layout) {
  const seconds = film.decisions.length * layout.decision_seconds;
  const words = { arrival: "arrives", collision: "collides", timeout: "is still waiting" };
  const name = Object.keys(layout.endings).find((key) => layout.endings[key] === film.ending);
  return `${words[name] ?? "drives"} after ${seconds} s`;
}
