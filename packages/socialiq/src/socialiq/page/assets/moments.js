// What happens in a film that does not happen in another of the same seed, in words at its moment.

const FIELDS = 5; // numbers of a vehicle in a frame: x, y, heading, speed, acceleration
const BOX = 7; // m from the centre: within it a vehicle is on the crossing
const HARD = -3.5; // m/s², from which a braking is hard
const FOR = 3; // frames that it lasts at least
const STANDS = 0.5; // m/s below which a car stands

/** Call `use(slot, identity, ego, numbers)` for each vehicle of a frame. */
function eachVehicle(frame, use) {
  for (let slot = 0; slot < frame.count; slot += 1) {
    const [x, y, , speed, acceleration] = frame.numbers.subarray(slot * FIELDS);
    use(frame.identity[slot], frame.agent[slot] >= 0, { x, y, speed, acceleration });
  }
}

/** Return the frame at which the ego and each other vehicle enter the crossing: `{ ego, others }`. */
export function crossingTimes(film) {
  const times = { ego: Infinity, others: new Map() };
  film.frames.forEach((frame, number) => eachVehicle(frame, (identity, ego, { x, y }) => {
    if (Math.abs(x) > BOX || Math.abs(y) > BOX) return;
    if (ego) times.ego = Math.min(times.ego, number);
    else if (!times.others.has(identity)) times.others.set(identity, number);
  }));
  return times;
}

/** Return the vehicles that brake hard, with the first and the last frame in which they do. */
export function hardBrakings(film) {
  const all = new Map();
  film.frames.forEach((frame, number) => eachVehicle(frame, (identity, ego, { speed, acceleration }) => {
    if (ego || acceleration > HARD || speed < 1) return;
    const [from, , count] = all.get(identity) ?? [number, number, 0];
    all.set(identity, [from, number, count + 1]);
  }));
  return new Map([...all].filter(([, [, , count]]) => count >= FOR));
}

/** Return the frames from which on the ego stands before it has crossed, and until which: null if it does not. */
function standing(film, until) {
  let from = null, to = null;
  film.frames.forEach((frame, number) => eachVehicle(frame, (_, ego, { speed }) => {
    if (!ego || speed > STANDS || number >= until) return;
    from ??= number;
    to = number;
  }));
  return from === null ? null : [from, to];
}

const cars = (count) => (count === 1 ? "a car" : `${count} cars`);

/**
 * Return what to say of a film beside another of the same seed.
 *
 * @param {[number, string][]} more Frames at which something else is said.
 * @returns {{at: (frame: number) => string, summary: string}} The caption at a frame, and one sentence of the whole.
 */
export function momentsOf(film, beside, layout, more = []) {
  const rate = layout.frames / layout.decision_seconds;
  const [mine, theirs] = [crossingTimes(film), crossingTimes(beside)];
  const [hard, spared] = [hardBrakings(film), hardBrakings(beside)];
  const braked = [...hard].filter(([identity]) => !spared.has(identity));
  const passed = [...mine.others].filter(([identity, when]) => when < mine.ego && (theirs.others.get(identity) ?? Infinity) > theirs.ego);
  const stands = standing(film, mine.ego);
  const seconds = (frames) => `${Math.round(frames / rate)} s`;
  const said = [[0, ""], ...more];
  if (stands && stands[1] - stands[0] >= rate) said.push([stands[0], "waits"]);
  passed.sort((first, second) => first[1] - second[1]).forEach(([, when], number) => said.push([when, `lets ${cars(number + 1)} pass`]));
  if (mine.ego < Infinity) said.push([mine.ego, "goes"]);
  for (const [, [from]] of braked) said.push([from, "a car has to brake hard"]);
  const last = film.frames.length - 1;
  const name = Object.keys(layout.endings).find((key) => layout.endings[key] === film.ending);
  const end = { arrival: `arrives after ${seconds(last)}`, collision: `collides after ${seconds(last)}`, timeout: `still waits after ${seconds(last)}` }[name];
  const counts = [passed.length ? `lets ${cars(passed.length)} pass` : "", braked.length ? `makes ${cars(braked.length)} brake hard` : ""].filter(Boolean);
  said.push([last, [end, ...counts].join(", ")]);
  said.sort((first, second) => first[0] - second[0]);
  const summary = [...counts, end].join(counts.length > 1 ? ", " : " and ");
  return { summary, at: (frame) => said.filter(([when]) => when <= frame).pop()[1] };
}
