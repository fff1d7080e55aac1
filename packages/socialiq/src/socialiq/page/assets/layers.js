// Layers of a perceptron: affine maps with an activation between them.
//
// Weights are float32 as in the file; sums are taken in float64, so only last bits differ from
// NumPy's float32.

import { UserError } from "./safetensors.js";

export const ACTIVATIONS = {
  relu: (value) => Math.max(value, 0),
  elu: (value) => (value > 0 ? value : Math.expm1(value)),
  tanh: Math.tanh,
};

let places = new Int32Array(0); // of inputs that aren't 0, and their values
let values = new Float64Array(0);

/** Return the layers in a file: `{ outputs, inputs, weight, bias }`, weights row by row. */
export function layersOf(arrays, weight, bias, count) {
  return Array.from({ length: count }, (_, number) => {
    const { shape, values: own } = arrays[weight + number];
    if (!own.every(Number.isFinite) || !arrays[bias + number].values.every(Number.isFinite)) throw new UserError("this network has weights that are no finite numbers: train or choose another one");
    return { outputs: shape[0], inputs: shape[1], weight: own, bias: arrays[bias + number].values };
  });
}

/** Return a first layer with the part of its last inputs, whose values are known, in its bias. */
export function fixed({ outputs, inputs, weight, bias }, known) {
  const kept = inputs - known.length;
  const less = new Float32Array(outputs * kept);
  const added = Float64Array.from(bias);
  for (let row = 0; row < outputs; row += 1) {
    less.set(weight.subarray(row * inputs, row * inputs + kept), row * kept);
    known.forEach((value, place) => (added[row] += weight[row * inputs + kept + place] * value));
  }
  return { outputs, inputs: kept, weight: less, bias: added };
}

/** Return a last layer of pairs as one of scores: its halves weighted by a direction. */
export function scored({ outputs, inputs, weight, bias }, [env, social]) {
  const half = outputs / 2;
  const mixed = (both, width) =>
    Float32Array.from({ length: half * width }, (_, at) => env * both[at] + social * both[at + half * width]);
  return { outputs: half, inputs, weight: mixed(weight, inputs), bias: mixed(bias, 1) };
}

/** Write a layer's values. Zeros are left out, and four rows are summed at a time: three times as fast. */
export function affine({ outputs, inputs, weight, bias }, from, to) {
  if (places.length < inputs) [places, values] = [new Int32Array(inputs), new Float64Array(inputs)];
  let count = 0;
  for (let place = 0; place < inputs; place += 1) {
    if (from[place] === 0) continue;
    places[count] = place;
    values[count] = from[place];
    count += 1;
  }
  const last = outputs - 1;
  for (let row = 0; row < outputs; row += 4) {
    const [second, third, fourth] = [Math.min(row + 1, last), Math.min(row + 2, last), Math.min(row + 3, last)];
    let [a, b, c, d] = [bias[row], bias[second], bias[third], bias[fourth]];
    for (let number = 0; number < count; number += 1) {
      const place = places[number];
      const value = values[number];
      a += weight[row * inputs + place] * value;
      b += weight[second * inputs + place] * value;
      c += weight[third * inputs + place] * value;
      d += weight[fourth * inputs + place] * value;
    }
    to[row] = a;
    to[second] = b;
    to[third] = c;
    to[fourth] = d;
  }
}

/** Layers one after another, with memory of their own. */
export class Layers {
  /**
   * @param {object[]} layers As `layersOf` returns them.
   * @param {string} activation A name of `ACTIVATIONS`.
   * @param {boolean} last Whether it follows the last layer too.
   */
  constructor(layers, activation, last) {
    this.layers = layers;
    this.activation = ACTIVATIONS[activation];
    this.last = last;
    this.between = layers.map((layer) => new Float64Array(layer.outputs));
  }

  /** Return the values of the last layer, which the next call overwrites. */
  values(input) {
    let value = input;
    this.layers.forEach((layer, number) => {
      const to = this.between[number];
      affine(layer, value, to);
      const act = this.last || number < this.layers.length - 1;
      if (act) for (let place = 0; place < to.length; place += 1) to[place] = this.activation(to[place]);
      value = to;
    });
    return value;
  }
}
