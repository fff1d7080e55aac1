// Vehicles on the road: who yields, who brakes because of the ego, and where it went wrong.

import { element } from "./bars.js";
import { NEAR, inMetres, roadPicture, viewOf } from "./road.js";

const BRAKING = -1.5; // m/s² from which brake lights are on

/** A canvas that shows scenes at any size. */
export class Stage {
  constructor(canvas, layout, extent = NEAR) {
    Object.assign(this, { canvas, layout, extent });
    this.context = canvas.getContext("2d", { alpha: false });
    this.road = null;
  }

  /** Fit the canvas to its box and to the screen's pixels; draw the road again if that changed. */
  fit(colours) {
    const { canvas } = this;
    const density = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.max(Math.round(canvas.clientWidth * density), 1);
    const height = Math.max(Math.round(canvas.clientHeight * density), 1);
    if (this.road && this.colours === colours && canvas.width === width && canvas.height === height) return;
    canvas.width = width;
    canvas.height = height;
    this.colours = colours;
    this.view = viewOf(width, height, this.extent);
    this.road = roadPicture(width, height, this.view, this.layout, colours);
  }

  /**
   * Draw a scene.
   *
   * @param {object[]} vehicles Of `film.sceneAt`; egos may have a colour of their own.
   * @param {{letter: string, colour: string, braking: Set<number>, near: boolean}} twin Whose scene it is.
   * @param {{vehicle: object, letter: string, colour: string}[]} ghosts Egos of other twins.
   * @param {object[]} people Of `film.sceneAt`.
   */
  draw(vehicles, twin, ghosts, people = []) {
    const { context, view, colours } = this;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.drawImage(this.road, 0, 0);
    inMetres(context, view);
    const ego = vehicles.find((one) => one.ego);
    if (twin.near && ego) this.reach(ego, twin.colour);
    for (const one of vehicles) if (twin.braking.has(one.identity) && ego) this.cause(ego, one);
    for (const one of vehicles) if (twin.braking.has(one.identity) || twin.braked?.has(one.identity)) this.outlined(one);
    for (const one of vehicles) if (!one.ego) this.vehicle(one, colours.other);
    for (const { vehicle, letter, colour } of ghosts) this.ghost(vehicle, letter, colour);
    for (const one of vehicles) if (one.ego) this.vehicle(one, one.colour ?? twin.colour, twin.letter);
    for (const one of people) this.person(one);
    for (const one of [...vehicles, ...people]) if (one.crashed) this.crash(one);
  }

  /** The circle within which neighbours count, while the ego is in its influence zone. */
  reach(ego, colour) {
    const { context } = this;
    context.beginPath();
    context.arc(ego.x, ego.y, this.layout.conflict_distance, 0, 2 * Math.PI);
    context.globalAlpha = 0.07;
    context.fillStyle = colour;
    context.fill();
    context.globalAlpha = 0.5;
    context.setLineDash([0.8, 1.2]);
    context.lineWidth = 0.18;
    context.strokeStyle = colour;
    context.stroke();
    context.setLineDash([]);
    context.globalAlpha = 1;
  }

  /** A line from the ego to a vehicle that brakes because of it. */
  cause(ego, other) {
    const { context, colours } = this;
    context.beginPath();
    context.moveTo(ego.x, ego.y);
    context.lineTo(other.x, other.y);
    context.strokeStyle = colours.alarm;
    context.lineWidth = 0.3;
    context.setLineDash([0.7, 0.9]);
    context.stroke();
    context.setLineDash([]);
  }

  /** The outline of a vehicle that had to brake. */
  outlined(vehicle) {
    const { vehicle_length: length, vehicle_width: width } = this.layout;
    this.placed(vehicle, (context) => {
      body(context, length + 1.6, width + 1.6);
      context.fillStyle = this.colours.alarm;
      context.fill();
    });
  }

  placed(vehicle, draw) {
    const { context } = this;
    context.save();
    context.translate(vehicle.x, vehicle.y);
    context.rotate(vehicle.heading);
    draw(context);
    context.restore();
  }

  vehicle(one, colour, letter) {
    const { vehicle_length: length, vehicle_width: width } = this.layout;
    const { colours } = this;
    this.placed(one, (context) => {
      body(context, length, width);
      context.fillStyle = colour;
      context.fill();
      context.lineWidth = 0.22;
      context.strokeStyle = colours.edge;
      context.stroke();
      context.fillStyle = colours.glass;
      context.beginPath();
      context.roundRect(length * 0.08, -width * 0.36, length * 0.16, width * 0.72, 0.25);
      context.fill();
      if (one.acceleration < BRAKING && one.speed > 0.2) lights(context, length, width, colours.alarm);
    });
    if (letter) this.name(one, letter, colours.onEgo);
    if (one.yielding && !one.ego) this.waits(one);
  }

  /** Who walks is a circle, drawn larger than life; who rides a line with a circle on it. */
  person(one) {
    const { colours } = this;
    const [size, length] = [one.width, one.length - one.width];
    this.placed(one, (context) => {
      context.beginPath();
      context.arc(0, 0, size, 0, 2 * Math.PI);
      context.fillStyle = colours.person;
      context.fill();
      context.lineWidth = 0.2;
      context.strokeStyle = colours.edge;
      context.stroke();
      if (!length) return;
      context.beginPath();
      context.moveTo(-length, 0);
      context.lineTo(length, 0);
      context.lineWidth = 0.4;
      context.strokeStyle = colours.person;
      context.stroke();
    });
  }

  /** Two bars in front of a vehicle that yields. */
  waits(one) {
    const { vehicle_length: length, vehicle_width: width } = this.layout;
    this.placed(one, (context) => {
      context.strokeStyle = this.colours.yields;
      context.lineWidth = 0.42;
      for (const ahead of [0.9, 1.7]) {
        context.beginPath();
        context.moveTo(length / 2 + ahead, -width / 2);
        context.lineTo(length / 2 + ahead, width / 2);
        context.stroke();
      }
    });
  }

  ghost(vehicle, letter, colour) {
    const { vehicle_length: length, vehicle_width: width } = this.layout;
    this.placed(vehicle, (context) => {
      body(context, length, width);
      context.globalAlpha = 0.28;
      context.fillStyle = colour;
      context.fill();
      context.globalAlpha = 1;
      context.strokeStyle = colour;
      context.lineWidth = 0.3;
      context.setLineDash([0.7, 0.45]);
      context.stroke();
      context.setLineDash([]);
    });
    this.name(vehicle, letter, this.colours.ghost);
  }

  name({ x, y }, letter, colour) {
    const { context } = this;
    context.fillStyle = colour;
    context.font = "600 1.75px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillText(letter, x, y + 0.1);
  }

  crash({ x, y }) {
    const { context, colours } = this;
    context.strokeStyle = colours.alarm;
    context.lineWidth = 0.55;
    context.beginPath();
    context.arc(x, y, 4, 0, 2 * Math.PI);
    context.stroke();
  }
}

/** Return a picture with a title above and a caption below, read aloud if it is `live`: `{ canvas, caption, figure, stage }`. */
export function staged({ title, place, live = false }, label, layout, extent) {
  const [canvas, caption] = [element("canvas", {}), element("p", { className: "caption" })];
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", label);
  if (live) caption.setAttribute("aria-live", "polite");
  const figure = element("figure", { className: `stage twin-${place}` }, element("figcaption", {}, element("strong", { textContent: title })), canvas, caption);
  return { canvas, caption, figure, stage: new Stage(canvas, layout, extent) };
}

function body(context, length, width) {
  context.beginPath();
  context.roundRect(-length / 2, -width / 2, length, width, [0.45, 0.8, 0.8, 0.45]);
}

function lights(context, length, width, colour) {
  context.fillStyle = colour;
  for (const side of [-1, 1]) context.fillRect(-length / 2 - 0.1, side * width * 0.33 - 0.28, 0.55, 0.56);
}
