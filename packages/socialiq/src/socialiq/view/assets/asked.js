// Episodes whose decisions come from a function that may take its time, as a server does.

/**
 * Drive a seed to its end.
 *
 * @param {Recorder} recorder Of `film.js`.
 * @param {(observations: Float32Array[], decisions: number[]) => Promise<number[]>} decide
 * @param {number} seed
 * @param {(film: object) => boolean} going Called after each decision; false stops the drive.
 * @returns {Promise<object?>} The film, or null if it was stopped.
 */
export async function filmBy(recorder, decide, seed, going) {
  const film = recorder.begin(seed);
  for (let more = true; more; ) {
    const [action] = await decide([recorder.observation], [film.decisions.length]);
    if (!going(film)) return null;
    more = recorder.decide(action);
  }
  return going(film) ? film : null;
}

/** Drive some seeds side by side; return `{ seed, env, social, ending, decisions }` of each. */
export async function episodesBy(core, decide, seeds) {
  const { none } = core.layout.endings;
  const rows = seeds.map((seed) => ({ seed, env: 0, social: 0, ending: none, decisions: 0 }));
  for (let row = 0; row < core.rows; row += 1) {
    if (row < rows.length) core.begin(row, seeds[row]);
    else core.skip(row);
  }
  core.run();
  for (;;) {
    const running = rows.map((_, row) => row).filter((row) => rows[row].ending === none);
    if (!running.length) return rows;
    const actions = await decide(running.map((row) => core.observation(row)), running.map((row) => rows[row].decisions));
    for (let row = 0; row < core.rows; row += 1) core.skip(row);
    running.forEach((row, place) => core.decide(row, actions[place]));
    core.run();
    for (const row of running) {
      const one = rows[row];
      one.env += core.arrays.rewards[2 * row];
      one.social += core.arrays.rewards[2 * row + 1];
      one.ending = core.arrays.ending[row];
      one.decisions += 1;
    }
  }
}
