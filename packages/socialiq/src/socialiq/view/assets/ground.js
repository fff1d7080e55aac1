// A recorded road and its users on a canvas, in metres: x to the east, y to the north.

const BRAKING = -1.5; // m/s² from which brake lights are on
const MARGIN = 6; // m around what is shown

/** Return the box around some points: `[left, low, right, high]`. */
export function boxOf(points) {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  for (const [x, y] of points) {
    box[0] = Math.min(box[0], x);
    box[1] = Math.min(box[1], y);
    box[2] = Math.max(box[2], x);
    box[3] = Math.max(box[3], y);
  }
  return box;
}

export class Ground {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {{left: number[][], right: number[][]}[]} lanes Bounds of the lanelets.
   */
  constructor(canvas, lanes) {
    Object.assign(this, { canvas, lanes, context: canvas.getContext("2d", { alpha: false }) });
  }

  /** Fit the canvas to its place on the page, and a box to the canvas; draw the road. */
  begin(box, colours) {
    const { canvas, context } = this;
    const density = Math.min(window.devicePixelRatio || 1, 2);
    const size = [canvas.clientWidth, canvas.clientHeight].map((length) => Math.max(Math.round(length * density), 1));
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    const [left, low, right, high] = box;
    this.scale = Math.min(canvas.width / (right - left + 2 * MARGIN), canvas.height / (high - low + 2 * MARGIN));
    this.colours = colours;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = colours.ground;
    context.fillRect(0, 0, canvas.width, canvas.height);
    const { scale } = this;
    context.setTransform(scale, 0, 0, -scale, canvas.width / 2 - (scale * (left + right)) / 2, canvas.height / 2 + (scale * (low + high)) / 2);
    this.road();
  }

  /** Lengths in metres that are so many pixels wide. */
  pixels(count) {
    return (count * Math.min(window.devicePixelRatio || 1, 2)) / this.scale;
  }

  road() {
    const { context, colours, lanes } = this;
    context.fillStyle = colours.road;
    for (const { left, right } of lanes) this.fill([...left, ...right.slice().reverse()]);
    context.strokeStyle = colours.marking;
    context.lineWidth = Math.max(0.12, this.pixels(0.7));
    for (const { left, right } of lanes) for (const bound of [left, right]) this.line(bound);
  }

  path(points) {
    this.context.beginPath();
    for (const [x, y] of points) this.context.lineTo(x, y);
  }

  fill(points) {
    this.path(points);
    this.context.closePath();
    this.context.fill();
  }

  line(points) {
    this.path(points);
    this.context.stroke();
  }

  /** A conflict area; that of the chosen conflict is stronger. */
  area(outline, chosen) {
    const { context, colours } = this;
    context.globalAlpha = chosen ? 0.55 : 0.25;
    context.fillStyle = colours.yields;
    this.fill(outline);
    context.globalAlpha = 1;
    context.strokeStyle = colours.yields;
    context.lineWidth = Math.max(0.15, this.pixels(chosen ? 2 : 1));
    this.path(outline);
    context.closePath();
    context.stroke();
  }

  /** A road user: `{ x, y, heading, speed, acceleration, length, width }`. */
  user(one, colour, label, waits) {
    const { context, colours } = this;
    const { length, width } = one;
    context.save();
    context.translate(one.x, one.y);
    context.rotate(one.heading);
    context.beginPath();
    context.roundRect(-length / 2, -width / 2, length, width, Math.min(width, length) / 4);
    context.fillStyle = colour;
    context.fill();
    context.lineWidth = 0.18;
    context.strokeStyle = colours.edge;
    context.stroke();
    context.fillStyle = colours.glass;
    context.fillRect(length * 0.12, -width * 0.36, length * 0.14, width * 0.72);
    if (one.acceleration < BRAKING && one.speed > 0.2) {
      context.fillStyle = colours.alarm;
      context.fillRect(-length / 2, -width / 2, length * 0.1, width);
    }
    if (waits) this.bars(length, width);
    context.restore();
    if (label) this.name(one, label);
  }

  /** Two bars in front of a vehicle that yields. */
  bars(length, width) {
    const { context, colours } = this;
    context.strokeStyle = colours.yields;
    context.lineWidth = 0.4;
    for (const ahead of [0.9, 1.7]) this.line([[length / 2 + ahead, -width / 2], [length / 2 + ahead, width / 2]]);
  }

  /** A name beside a road user, upright and of a size that can be read. */
  name({ x, y, width }, label) {
    const { context, colours } = this;
    const size = Math.max(2, this.pixels(12));
    context.save();
    context.translate(x, y);
    context.scale(1, -1);
    context.font = `600 ${size}px system-ui, sans-serif`;
    context.textAlign = "center";
    context.fillStyle = colours.ghost;
    context.fillText(label, 0, -(width / 2 + 0.35 * size));
    context.restore();
  }
}
