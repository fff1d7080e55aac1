// The dial: a Q-network that takes the social angle as an input (`socialiq.nn.dial_network`).
//
// Weights are float32 as in the file; sums are taken in float64, so only last bits differ from
// NumPy's float32.

import { UserError, readArrays } from "./safetensors.js";

const ROW = 7; // numbers of a vehicle in an observation

/** Return the policy in a file of `socialiq`: `at(angle)` gives the decisions of one angle. */
export function dialOf(bytes) {
  const { header, arrays } = readArrays(bytes);
  if (header.kind !== "dial") {
    throw new UserError(`a dial is needed, and this file holds: ${String(header.kind).slice(0, 40)}`);
  }
  return new Dial(header, arrays);
}

export class Dial {
  constructor(header, arrays) {
    this.low = header.low;
    this.high = header.high;
    this.knots = header.knots ?? [];
    this.pairs = header.pairs ?? false;
    this.settings = header.settings ?? [];
    this.view = header.view;
    this.provenance = header.provenance;
    this.layers = listed(arrays, "weight_", "bias_", header.layers);
    this.encoder = this.view ? listed(arrays, "view_weight_", "view_bias_", this.view.layers) : [];
    if (header.activation !== "relu" || !this.view?.pooled) {
      throw new UserError("this page reads dials with the view `set` and the activation `relu` only");
    }
    this.times = this.view.times ?? 0;
    this.features = this.view.n_features;
  }

  /** Return the network of one angle in degrees, whose direction is part of the first bias. */
  at(angle) {
    if (!(angle >= this.low && angle <= this.high)) {
      throw new UserError(`this dial's angles are ${this.low} to ${this.high} degrees`);
    }
    let setting = angle;
    for (const [first, network] of this.settings) if (angle >= first) setting = network;
    const direction = directionOf(setting);
    const inputs = [...direction, ...hats(setting, this.knots)].map(Math.fround);
    const layers = this.layers.slice();
    layers[0] = fixed(layers[0], inputs);
    if (this.pairs) layers.push(scored(layers.pop(), direction.map(Math.fround)));
    return new Network(this, layers);
  }
}

/** Return (cos α, sin α) of an angle in degrees, exact at multiples of 90. */
export function directionOf(angle) {
  const exact = { 0: [1, 0], 90: [0, 1], 180: [-1, 0], 270: [0, -1] }[angle];
  const radians = (angle * Math.PI) / 180;
  return exact ?? [Math.cos(radians), Math.sin(radians)];
}

function hats(angle, knots) {
  if (!knots.length) return [];
  const middle = (knots[0] + knots[knots.length - 1]) / 2;
  const offset = ((((angle - middle + 180) % 360) + 360) % 360) - 180;
  const gap = knots[1] - knots[0];
  return knots.map((knot) => Math.max(1 - Math.abs(offset - (knot - middle)) / gap, 0));
}

function listed(arrays, weight, bias, count) {
  return Array.from({ length: count }, (_, number) => {
    const { shape, values } = arrays[weight + number];
    return { outputs: shape[0], inputs: shape[1], weight: values, bias: arrays[bias + number].values };
  });
}

/** Return a first layer with the part of the last inputs, which are the angle's, in its bias. */
function fixed({ outputs, inputs, weight, bias }, ofAngle) {
  const kept = inputs - ofAngle.length;
  const less = new Float32Array(outputs * kept);
  const added = Float64Array.from(bias);
  for (let row = 0; row < outputs; row += 1) {
    less.set(weight.subarray(row * inputs, row * inputs + kept), row * kept);
    ofAngle.forEach((value, place) => (added[row] += weight[row * inputs + kept + place] * value));
  }
  return { outputs, inputs: kept, weight: less, bias: added };
}

/** Return a last layer that gives the score of pairs at a direction. */
function scored({ outputs, inputs, weight, bias }, [env, social]) {
  const half = outputs / 2;
  const mixed = (values, width) =>
    Float64Array.from({ length: half * width }, (_, at) => env * values[at] + social * values[at + half * width]);
  return { outputs: half, inputs, weight: mixed(weight, inputs), bias: mixed(bias, 1) };
}

/** Network of one angle: values of the actions of an observation. */
class Network {
  constructor({ view, encoder, times }, layers) {
    Object.assign(this, { view, encoder, times, layers });
    this.row = new Float64Array(encoder[0].inputs);
    this.hidden = encoder.map((layer) => new Float64Array(layer.outputs));
    this.between = layers.map((layer) => new Float64Array(layer.outputs));
    this.input = new Float64Array(layers[0].inputs);
  }

  /** Return Q of each action. The time, a number of decisions, is seen if the dial has a clock. */
  values(observation, time = 0) {
    this.encode(observation, time);
    let value = this.input;
    this.layers.forEach((layer, number) => {
      affine(layer, value, this.between[number], number < this.layers.length - 1);
      value = this.between[number];
    });
    return value;
  }

  /** Return the action of the largest value, the first of equals. */
  decide(observation, time = 0) {
    const values = this.values(observation, time);
    let best = 0;
    for (let action = 1; action < values.length; action += 1) if (values[action] > values[best]) best = action;
    return best;
  }

  encode(observation, time) {
    const { input, times } = this;
    const width = this.hidden[this.hidden.length - 1].length;
    input.fill(0);
    if (time < times) input[time] = 1;
    this.absolute(observation, 0, input, times);
    const sums = times + ROW - 1;
    const rows = Math.floor(observation.length / ROW);
    for (let row = 1; row < rows; row += 1) {
      if (!(observation[row * ROW] > 0)) continue;
      this.vehicle(observation, row * ROW);
      let seen = this.row;
      this.encoder.forEach((layer, number) => {
        affine(layer, seen, this.hidden[number], true);
        seen = this.hidden[number];
      });
      for (let place = 0; place < width; place += 1) {
        input[sums + place] += seen[place];
        input[sums + width + place] = Math.max(input[sums + width + place], seen[place]);
      }
    }
  }

  absolute(observation, from, to, at) {
    const { scale } = this.view;
    for (let place = 1; place < ROW; place += 1) {
      to[at + place - 1] = observation[from + place] * (place < 5 ? scale : 1);
    }
  }

  /** Write the features of another vehicle: presence, absolute, and relative to the ego. */
  vehicle(observation, from) {
    const { row, view } = this;
    row[0] = observation[from];
    this.absolute(observation, from, row, 1);
    if (!view.relative) return;
    const [, x, y, vx, vy, cos, sin] = observation;
    turned(row, ROW, observation[from + 1] - x, observation[from + 2] - y, cos, sin, view.scale);
    turned(row, ROW + 2, observation[from + 3] - vx, observation[from + 4] - vy, cos, sin, view.scale);
    turned(row, ROW + 4, observation[from + 5], observation[from + 6], cos, sin, 1);
  }
}

function turned(row, at, x, y, cos, sin, scale) {
  row[at] = scale * (x * cos + y * sin);
  row[at + 1] = scale * (y * cos - x * sin);
}

function affine({ outputs, inputs, weight, bias }, from, to, rectified) {
  for (let row = 0, at = 0; row < outputs; row += 1) {
    let sum = bias[row];
    for (let place = 0; place < inputs; place += 1, at += 1) sum += weight[at] * from[place];
    to[row] = rectified && sum < 0 ? 0 : sum;
  }
}
