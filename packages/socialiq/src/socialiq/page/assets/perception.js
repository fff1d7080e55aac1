// The front end between sensors and a network (`worlds.highway.perception`), in the same operations of float32.

const f = Math.fround;
const [ROW, TRACK] = [7, 10]; // of a track: a vehicle, the variances of position and velocity, decisions unseen
const [POSITION, SPEED] = [100, 20]; // m and m/s, the units of observations
const SECOND = f(SPEED / POSITION); // a decision's way at a velocity, both in these units
const [GATE, DEVIATIONS, FAR, TINY] = [f(4 / POSITION), 3, 100, f(1e-12)];
const [GROWTH, SPEED_GROWTH] = [f((1 / POSITION) ** 2), f((2 / SPEED) ** 2)]; // of variances, in a decision
const CARRIED = 3; // decisions for which a vehicle that is not seen is carried on
const [STEP, FASTEST] = [4.5, 9]; // m/s between target speeds, and the largest
const LEFT = (1 - 0.1 / 0.6) ** 10; // of a difference to the target speed, after a decision
const LAG = f((1 - LEFT) * 0.6); // s
const COSTS = [[1, 1], [2, 1], [3, SECOND], [4, SECOND]]; // numbers by which a vehicle is recognised, with their units
const FILTERS = [[1, POSITION, ROW], [3, 2 * SPEED, ROW + 1]]; // first number, unit, place of the variance

/** Return the nearest whole number, of a half the even one. */
function rounded(value) {
  const low = Math.floor(value);
  return value - low === 0.5 ? low + Math.abs(low % 2) : Math.round(value);
}

/** Return a track after a decision at constant velocity. */
function moved([there, x, y, vx, vy, cos, sin, place, speed, unseen]) {
  const grown = f(f(place + f(f(speed * SECOND) * SECOND)) + f(there * GROWTH));
  return [there, f(x + f(vx * SECOND)), f(y + f(vy * SECOND)), vx, vy, cos, sin, grown, f(speed + f(there * SPEED_GROWTH)), unseen + there];
}

/** Return for each sensed vehicle the number of the track that is the same: nearest to each other, within the gate. */
function sameAs(tracks, sensed) {
  const costs = tracks.map((track) => sensed.map((vehicle) => COSTS.reduce((sum, [place, unit]) => {
    const away = f(f(track[place] - vehicle[place]) * unit);
    return f(sum + f(away * away));
  }, FAR * (2 - track[0] - vehicle[0]))));
  return sensed.map((_, column) => costs.findIndex((row, number) => {
    const reach = f(GATE + f(DEVIATIONS * f(Math.sqrt(tracks[number][ROW]))));
    return row[column] <= f(reach * reach) && row[column] <= Math.min(...row) && costs.every((other) => row[column] <= other[column]);
  }));
}

/** Return a track of a sensed vehicle, weighed against what was predicted of it (a Kalman filter), if anything was. */
function filtered(vehicle, prior, noise) {
  const track = [...vehicle, 0, 0, 0];
  for (const [first, unit, place] of FILTERS) {
    const deviation = f(f(noise) * f(1 / unit));
    const error = f(deviation * deviation);
    const before = prior ? prior[place] : 0;
    const weight = prior ? f(error / f(f(before + error) + TINY)) : 0;
    for (const at of prior ? [first, first + 1] : []) track[at] = f(vehicle[at] + f(weight * f(prior[at] - vehicle[at])));
    track[place] = prior ? f(weight * before) : error;
  }
  return track;
}

/** Follows vehicles through one episode, and predicts them to the time at which an action takes effect. */
export class FrontEnd {
  /** @param {object} shift `latency` in decisions, `noise` in m. */
  constructor({ latency, noise }) {
    Object.assign(this, { noise, tracks: [], target: FASTEST, waiting: new Array(latency).fill(0) });
  }

  /** Return what a network is shown of an observation, one for each decision in turn. */
  see(observation) {
    const [ego, ...slots] = Array.from({ length: observation.length / ROW }, (_, number) => [...observation.subarray(number * ROW, (number + 1) * ROW)]);
    const sensed = slots.filter(([there]) => there > 0);
    const tracks = this.tracks.map(moved);
    const same = sameAs(tracks, sensed);
    const carried = tracks.filter(([, x, y, , , , , , , unseen], number) => !same.includes(number) && f(f(x * x) + f(y * y)) <= 1 && unseen <= CARRIED);
    this.tracks = [...sensed.map((vehicle, number) => filtered(vehicle, tracks[same[number]], this.noise)), ...carried].slice(0, slots.length);
    const seen = new Float32Array(observation.length);
    seen.set(this.driven(ego));
    this.tracks.forEach(([there, x, y, vx, vy, cos, sin], number) => {
      const ahead = f(SECOND * this.waiting.length);
      seen.set([there, f(x + f(vx * ahead)), f(y + f(vy * ahead)), vx, vy, cos, sin], (number + 1) * ROW);
    });
    return seen;
  }

  /** Return the ego after the actions that wait, by highway-env's control of speed. */
  driven([there, x, y, vx, vy, cos, sin]) {
    if (!this.waiting.length) return [there, x, y, vx, vy, cos, sin];
    let [target, now, way] = [this.target, f(f(f(vx * cos) + f(vy * sin)) * SPEED), 0];
    this.waiting.forEach((action, number) => {
      if (action) target = STEP * Math.min(Math.max(rounded(f(now / STEP)) + action, 0), FASTEST / STEP);
      way = f(f(way + target) + f(f(now - target) * LAG));
      now = f(target + f(f(now - target) * f(LEFT)));
      if (number === 0) this.target = target;
    });
    const along = (value, unit) => [cos, sin].map((part) => f(f(value * part) * f(1 / unit)));
    const [[dx, dy], velocity] = [along(way, POSITION), along(now, SPEED)];
    return [there, f(x + dx), f(y + dy), ...velocity, cos, sin];
  }

  /** Take an action that was decided: it waits, and the first one that waited is carried out. */
  decided(action) {
    if (this.waiting.length) this.waiting = [...this.waiting.slice(1), action - 1];
  }
}
