// Faults of a driver: actions that come late, vehicles that are not seen, wrong positions (`worlds.highway.shifts`).

import { FrontEnd } from "./perception.js";

const ROW = 7; // numbers of a vehicle: presence, x, y, vx, vy, cos, sin
const UNITS = [100, 100, 20, 20]; // m and m/s, of x, y, vx, vy
const ERRORS = [1, 1, 0.5, 0.5]; // of them, for each metre of noise
const [UNSEEN, NOISE] = [1, 2]; // counters of their random numbers
const WORD = (1n << 64n) - 1n;
const IDLE = 1;

/** Return SplitMix64 of a number (Steele et al. 2014). */
function mixed(number) {
  let word = (number + 0x9e3779b97f4a7c15n) & WORD;
  word = ((word ^ (word >> 30n)) * 0xbf58476d1ce4e5b9n) & WORD;
  word = ((word ^ (word >> 27n)) * 0x94d049bb133111ebn) & WORD;
  return word ^ (word >> 31n);
}

const counted = (key, ...counters) => counters.reduce((number, counter) => mixed(number ^ mixed(BigInt(counter))), key);

/** Return a number in (0, 1) for a key and counters. */
function uniform(key, ...counters) {
  return (Number(counted(key, ...counters) >> 12n) + 0.5) * 2 ** -52;
}

/** Return a standard normal number by Box and Muller. */
function normal(key) {
  return Math.sqrt(-2 * Math.log(uniform(key, 0))) * Math.cos(2 * Math.PI * uniform(key, 1));
}

/** Return what is shown of an observation at a time in decisions: the vehicles that are left first, in their order. */
function shown(observation, { unseen, noise }, key, time) {
  const rows = new Float32Array(observation.length);
  rows.set(observation.subarray(0, ROW));
  const [hides, errs] = [counted(key, UNSEEN, time), counted(key, NOISE, time)];
  let to = ROW;
  for (let from = ROW; from < rows.length; from += ROW) {
    const number = from / ROW - 1;
    if (observation[from] === 0 || uniform(hides, number) < unseen) continue;
    rows.set(observation.subarray(from, from + ROW), to);
    if (noise) UNITS.forEach((unit, column) => (rows[to + 1 + column] += (normal(counted(errs, number, column)) * (noise * ERRORS[column])) / unit));
    to += ROW;
  }
  return rows.map((value) => Math.min(Math.max(value, -1), 1));
}

/** Drives one episode of a network with faults: keeps the actions that wait, and what the front end remembers. */
class Driver {
  constructor(network, shift, seed) {
    Object.assign(this, { network, shift, key: mixed(BigInt(seed)), waiting: new Array(shift.latency).fill(IDLE) });
    this.front = shift.front ? new FrontEnd(shift) : null;
  }

  /** Return the action that is carried out at a time in decisions. */
  decide(observation, time) {
    const { front, shift } = this;
    const sensed = shown(observation, shift, this.key, time);
    const action = this.network.decide(front ? front.see(sensed) : sensed, front ? time + shift.latency : time);
    front?.decided(action);
    this.waiting.push(action);
    return this.waiting.shift();
  }
}

export const NO_SHIFT = { latency: 0, unseen: 0, noise: 0, front: false };

/**
 * Return a network with faults, or itself without any.
 *
 * @param {object} shift `latency` in decisions, `unseen` chance of each vehicle in each decision, `noise` in m, and whether
 *   a `front` end that knows them is between.
 */
export function shifted(network, shift = NO_SHIFT) {
  return Object.values(shift).some(Boolean) ? { of: (seed) => new Driver(network, shift, seed) } : network;
}
