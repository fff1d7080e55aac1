// What a network reads of an observation (`socialiq.nn.view`): the plain numbers, or vehicles as a list or a set.

import { Layers, layersOf } from "./layers.js";

const ROW = 7; // numbers of a vehicle: presence, x, y, vx, vy, cos, sin

/** Return the view of a file's content: `width`, and `write(observation, time, input)`. */
export function viewOf(header, arrays, features) {
  const { view } = header;
  if (!view) return new PlainView(features);
  const encoder = new Layers(layersOf(arrays, "view_weight_", "view_bias_", view.layers), "relu", true);
  return new VehicleView(view, encoder);
}

/** The numbers as they are, with the time as the last if the network reads it. */
class PlainView {
  constructor(features) {
    this.width = features;
  }

  write(observation, time, input) {
    input.set(observation.length > this.width ? observation.subarray(0, this.width) : observation);
    if (this.width > observation.length) input[observation.length] = time;
  }
}

/** The time one-hot, the ego, then the other vehicles: one after another, or their sum and maximum. */
class VehicleView {
  constructor(view, encoder) {
    Object.assign(this, view, { encoder });
    this.times = view.times ?? 0;
    this.others = Math.floor(view.n_features / ROW) - 1;
    this.row = new Float64Array(ROW + (view.relative ? ROW - 1 : 0));
    this.encoded = view.pooled ? encoder.layers[encoder.layers.length - 1].outputs : 0;
    const seen = view.pooled ? 2 * this.encoded : this.others * this.row.length;
    this.width = this.times + ROW - 1 + seen;
  }

  write(observation, time, input) {
    input.fill(0);
    if (time < this.times) input[time] = 1;
    this.absolute(observation, 0, input, this.times);
    const first = this.times + ROW - 1;
    for (let number = 0; number < this.others; number += 1) {
      const from = (number + 1) * ROW;
      if (!(observation[from] > 0)) continue;
      this.vehicle(observation, from);
      if (this.pooled) this.pool(input, first);
      else input.set(this.row, first + number * this.row.length);
    }
  }

  pool(input, first) {
    const seen = this.encoder.values(this.row);
    for (let place = 0; place < this.encoded; place += 1) {
      const largest = first + this.encoded + place;
      input[first + place] += seen[place];
      input[largest] = Math.max(input[largest], seen[place]);
    }
  }

  absolute(observation, from, to, at) {
    for (let place = 1; place < ROW; place += 1) {
      to[at + place - 1] = observation[from + place] * (place < 5 ? this.scale : 1);
    }
  }

  /** Write the features of another vehicle: presence, absolute, and relative to the ego. */
  vehicle(observation, from) {
    const { row, scale } = this;
    row[0] = observation[from];
    this.absolute(observation, from, row, 1);
    if (!this.relative) return;
    const [, x, y, vx, vy, cos, sin] = observation;
    turned(row, ROW, observation[from + 1] - x, observation[from + 2] - y, cos, sin, scale);
    turned(row, ROW + 2, observation[from + 3] - vx, observation[from + 4] - vy, cos, sin, scale);
    turned(row, ROW + 4, observation[from + 5], observation[from + 6], cos, sin, 1);
  }
}

function turned(row, at, x, y, cos, sin, scale) {
  row[at] = scale * (x * cos + y * sin);
  row[at + 1] = scale * (y * cos - x * sin);
}
