// Driven episodes as a file of demonstrations, which `socialiq train` reads.

import { writeArrays } from "./safetensors.js";

const VERSION = 1; // of the schema, `socialiq.demonstrations.files`

/** Return the file's bytes; every film is a whole episode. */
export function demonstrationsFile(films, layout) {
  const rows = films.flatMap((film, episode) =>
    film.decisions.map((one, step) => ({
      ...one, episode, step, ending: step === film.decisions.length - 1 ? film.ending : layout.endings.none,
    })),
  );
  const { arrival, collision, timeout } = layout.endings;
  const column = (dtype, Kind, value) => ({ dtype, shape: [rows.length], values: Kind.from(rows, value) });
  const arrays = {
    observation: table(rows, "before"),
    next_observation: table(rows, "after"),
    action: column("I32", Int32Array, (row) => row.action),
    terminated: column("BOOL", Uint8Array, (row) => Number([arrival, collision].includes(row.ending))),
    truncated: column("BOOL", Uint8Array, (row) => Number(row.ending === timeout)),
    ending: column("I8", Int8Array, (row) => row.ending),
    r_env: column("F64", Float64Array, (row) => row.rewards[0]),
    r_social: column("F64", Float64Array, (row) => row.rewards[1]),
    mode: column("I8", Int8Array, () => 0),
    episode: column("I32", Int32Array, (row) => row.episode),
    step: column("I32", Int32Array, (row) => row.step),
  };
  const source = { world: "intersection", by: "socialiq page", seeds: films.map((film) => film.seed) };
  return writeArrays("demonstrations", VERSION, arrays, { mode_names: ["human"], n_actions: layout.actions.length, source });
}

function table(rows, name) {
  const width = rows[0][name].length;
  const values = new Float32Array(rows.length * width);
  rows.forEach((row, number) => values.set(row[name], number * width));
  return { dtype: "F32", shape: [rows.length, width], values };
}
