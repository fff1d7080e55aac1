// The road of the intersection, drawn once for each size and colour scheme.

// Metres seen to the west and east of the centre, and by which the view lies further south.
export const NEAR = { reach: 31, south: 14 }; // there one ego starts
export const WHOLE = { reach: 64, south: 0 }; // every arm, where several agents start
const CURB = 7; // m, radius of the corners
const STOP_LINE = 11; // m from the centre, where approaches end

/** Return the transform of a picture of some pixels and an extent: metres to pixels. */
export function viewOf(width, height, { reach, south }) {
  const scale = width / (2 * reach);
  return { scale, x: width / 2, y: height / 2 - south * scale };
}

/** Apply a view to a context, so that its units are metres. */
export function inMetres(context, view) {
  context.setTransform(view.scale, 0, 0, view.scale, view.x, view.y);
}

/** Return a canvas with the road alone. */
export function roadPicture(width, height, view, layout, colours) {
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height;
  const context = canvas.getContext("2d");
  context.fillStyle = colours.ground;
  context.fillRect(0, 0, width, height);
  inMetres(context, view);
  const far = 100; // m, beyond any picture
  asphalt(context, layout.lane_width, far, colours);
  markings(context, layout, far, colours);
  return canvas;
}

/** Four arms of two lanes with round corners, as one outline: a corner, turned four times. */
function asphalt(context, half, far, colours) {
  const corner = half + CURB;
  const outline = new Path2D();
  let turn = ([x, y]) => [x, y];
  for (let number = 0; number < 4; number += 1) {
    outline.lineTo(...turn([half, far]));
    outline.lineTo(...turn([half, corner]));
    outline.arcTo(...turn([half, half]), ...turn([corner, half]), CURB);
    outline.lineTo(...turn([far, half]));
    const before = turn;
    turn = ([x, y]) => before([y, -x]);
  }
  outline.closePath();
  context.fillStyle = colours.road;
  context.fill(outline);
  context.strokeStyle = colours.curb;
  context.lineWidth = 0.35;
  context.stroke(outline);
}

function markings(context, layout, far, colours) {
  const half = layout.lane_width;
  context.strokeStyle = colours.marking;
  for (let arm = 0; arm < 4; arm += 1) {
    context.save();
    context.rotate((arm * Math.PI) / 2);
    context.lineWidth = 0.16;
    context.setLineDash([2.4, 2.4]);
    line(context, 0, STOP_LINE + 0.6, 0, far);
    context.setLineDash([]);
    context.lineWidth = 0.5;
    line(context, 0.2, STOP_LINE, half - 0.2, STOP_LINE);
    if (layout.people) ways(context, layout, far, colours);
    context.restore();
  }
  context.setLineDash([0.9, 1.5]);
  context.lineWidth = 0.1;
  context.globalAlpha = 0.45;
  for (const lane of layout.lanes) if (!lane.straight) arc(context, lane);
  context.globalAlpha = 1;
  context.setLineDash([]);
}

/** The crosswalk of an arm, and the bicycle lane on its right if there is one. */
function ways(context, { lane_width: half, people: { crosswalk: [near, away], bicycles } }, far, colours) {
  context.fillStyle = colours.marking;
  for (let x = -half + 0.3; x < half; x += 1) context.fillRect(x, near, 0.5, away - near);
  if (!bicycles) return;
  const width = 2 * (bicycles - half);
  context.globalAlpha = 0.5;
  context.fillStyle = colours.lane;
  context.fillRect(half, -far, width, 2 * far);
  context.globalAlpha = 1;
}

function line(context, ...[x, y, toX, toY]) {
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(toX, toY);
  context.stroke();
}

function arc(context, { x, y, radius, phase, sense, length }) {
  context.beginPath();
  context.arc(x, y, radius, phase, phase + (sense * length) / radius, sense < 0);
  context.stroke();
}
