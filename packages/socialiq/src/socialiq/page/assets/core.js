// The compiled core: its memory as typed arrays, and its commands.

const VIEWS = {
  bool: Uint8Array, int8: Int8Array, int32: Int32Array, int64: BigInt64Array,
  uint64: BigUint64Array, float32: Float32Array, float64: Float64Array,
};

/** Return the bytes of a base64 text. */
export function bytesOf(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}

/**
 * Episodes side by side in the compiled core.
 *
 * `arrays` holds a view of each array, one row for each episode; records are read by `field`.
 */
export class Core {
  /**
   * @param {WebAssembly.Module} module Compiled `core.wasm`.
   * @param {object} layout Result of `webassembly.layout`.
   * @param {number} rows Number of episodes.
   * @param {boolean} traced Whether to keep the vehicles of every sub-step.
   */
  constructor(module, layout, rows, traced) {
    this.layout = layout;
    this.rows = rows;
    this.traced = traced ? rows : 0;
    this.program = new WebAssembly.Instance(module).exports;
    this.places = {};
    this.arrays = {};
    for (const array of layout.arrays) this.place(array);
    this.memory = new DataView(this.program.memory.buffer);
    this.arrays.settings.set(bytesOf(layout.settings));
    this.status = this.program.allocate(16);
    this.pointers = [this.status, this.status + 8, ...layout.arrays.map((one) => this.places[one.name])];
  }

  place({ name, type, bytes, shape }) {
    const rows = name.endsWith("trace") ? this.traced : name === "settings" ? 1 : this.rows;
    const count = shape.reduce((product, length) => product * length, rows);
    const place = this.program.allocate(Math.max(count * bytes, 1));
    this.places[name] = place;
    const View = VIEWS[type] ?? Uint8Array; // records as bytes
    const length = VIEWS[type] ? count : count * bytes;
    this.arrays[name] = new View(this.program.memory.buffer, place, length);
  }

  /** Carry out the commands in `arrays.commands`. */
  run() {
    const { agents, capacity, persons, observed } = this.layout;
    const status = this.program.step_rows(...this.pointers, this.rows, this.traced, agents, capacity, persons, observed);
    if (status !== 0) throw new Error(`the core stopped with status ${status}`);
  }

  /** Begin the episode of a seed (a whole number below 2^64) in a row; `run` carries it out. */
  begin(row, seed) {
    this.arrays.commands[row] = this.layout.commands.reset;
    this.arrays.entropy[row] = BigInt(seed);
    this.arrays.seeded[row] = 1;
  }

  /** Decide in a row, an action for each agent; `run` carries it out. */
  decide(row, ...actions) {
    this.arrays.commands[row] = this.layout.commands.decide;
    this.arrays.seeded[row] = 0;
    this.arrays.actions.set(actions.map(BigInt), row * this.layout.agents);
  }

  /** Leave a row as it is in the next `run`. */
  skip(row) {
    this.arrays.commands[row] = this.layout.commands.skip;
    this.arrays.seeded[row] = 0;
  }

  /** Return a function that reads a field of the records of an array, by their index. */
  field(array, name) {
    const kind = this.layout.arrays.find((one) => one.name === array).type;
    const { size, fields } = this.layout.records[kind];
    const [type, offset] = fields[name];
    const first = this.places[array] + offset;
    const memory = this.memory;
    const read = {
      float64: (at) => memory.getFloat64(at, true), int64: (at) => Number(memory.getBigInt64(at, true)),
      int32: (at) => memory.getInt32(at, true), int8: (at) => memory.getInt8(at),
      bool: (at) => memory.getUint8(at), uint64: (at) => memory.getBigUint64(at, true),
    }[type];
    return (index) => read(first + index * size);
  }

  /** Return what an agent of a row observes, a view of the core's memory. */
  observation(row, agent = 0) {
    const { agents } = this.layout;
    const length = this.arrays.observation.length / (this.rows * agents);
    const first = (row * agents + agent) * length;
    return this.arrays.observation.subarray(first, first + length);
  }
}
