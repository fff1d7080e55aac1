// The dial: a Q-network that takes the social angle as an input (`socialiq.nn.dial_network`).

import { ACTIVATIONS, Layers, fixed, layersOf, scored } from "./layers.js";
import { UserError, readArrays } from "./safetensors.js";
import { viewOf } from "./view.js";

/** Return the policy in a file of `socialiq`: `at(angle)` gives the decisions of one angle. */
export function dialOf(bytes) {
  const { header, arrays } = readArrays(bytes);
  if (header.kind !== "dial") {
    throw new UserError(`a dial is needed, and this file holds: ${String(header.kind).slice(0, 40)}`);
  }
  return new Dial(header, arrays);
}

/** Policies of all angles; `low` and `high` are the ends of its range in degrees. */
export class Dial {
  constructor(header, arrays) {
    this.low = header.low;
    this.high = header.high;
    this.knots = header.knots ?? [];
    this.pairs = header.pairs ?? false;
    this.settings = header.settings ?? [];
    this.activation = header.activation;
    this.layers = layersOf(arrays, "weight_", "bias_", header.layers);
    if (!(this.activation in ACTIVATIONS)) {
      throw new UserError(`this page reads the activations ${Object.keys(ACTIVATIONS).join(", ")} only`);
    }
    this.view = viewOf(header, arrays, this.layers[0].inputs - 2 - this.knots.length);
  }

  /** Return the network of one angle in degrees, whose direction is part of the first bias. */
  at(angle) {
    if (!(angle >= this.low && angle <= this.high)) {
      throw new UserError(`this dial's angles are ${this.low} to ${this.high} degrees`);
    }
    let setting = angle;
    for (const [first, network] of this.settings) if (angle >= first) setting = network;
    const direction = directionOf(setting).map(Math.fround);
    const layers = this.layers.slice();
    layers[0] = fixed(layers[0], [...direction, ...hats(setting, this.knots).map(Math.fround)]);
    if (this.pairs) layers.push(scored(layers.pop(), direction));
    return new Network(this.view, new Layers(layers, this.activation, false));
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

/** Network of one angle: values of the actions of an observation. */
class Network {
  constructor(view, layers) {
    this.view = view;
    this.layers = layers;
    this.input = new Float64Array(view.width);
  }

  /** Return the driver of an episode: itself, as it remembers nothing. */
  of() {
    return this;
  }

  /** Return Q of each action. The time, a number of decisions, is read by a dial with a clock. */
  values(observation, time = 0) {
    this.view.write(observation, time, this.input);
    return this.layers.values(this.input);
  }

  /** Return the action of the largest value, the first of equals. */
  decide(observation, time = 0) {
    const values = this.values(observation, time);
    let best = 0;
    for (let action = 1; action < values.length; action += 1) if (values[action] > values[best]) best = action;
    return best;
  }
}
