// The dial: a quarter circle from 0 degrees (for itself) to 90 (for the others), an ARIA slider.

const NAMESPACE = "http://www.w3.org/2000/svg";
const CENTRE = [40, 232];
const RADIUS = 178;
const GRIP = 5; // degrees around a hand that take hold of it

/** Return an SVG element with attributes. */
export function svg(name, attributes, text = "") {
  const element = document.createElementNS(NAMESPACE, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.textContent = text;
  return element;
}

/** Return the point of an angle in degrees at a share of the radius; y grows downwards. */
function pointOf(angle, share = 1) {
  const radians = (angle * Math.PI) / 180;
  return [CENTRE[0] + share * RADIUS * Math.cos(radians), CENTRE[1] - share * RADIUS * Math.sin(radians)];
}

export class Knob {
  /**
   * @param {SVGElement} root Element that is filled.
   * @param {number[]} range Smallest and largest angle, whole degrees.
   * @param {(angle: number) => void} turned Called with a whole number of degrees.
   * @param {(place: number) => void} chosen Called with the place of a twin whose grip is pressed.
   */
  constructor(root, [low, high], turned, chosen = () => {}) {
    Object.assign(this, { root, low, high, turned, chosen, angle: low, others: [] });
    root.setAttribute("aria-valuemin", low);
    root.setAttribute("aria-valuemax", high);
    this.drawScale();
    this.hands = svg("g", {});
    root.append(this.hands);
    root.addEventListener("keydown", (event) => this.key(event));
    root.addEventListener("pointerdown", (event) => this.press(event));
    root.addEventListener("touchstart", (event) => this.held && event.preventDefault(), { passive: false }); // or it scrolls
    root.addEventListener("pointermove", (event) => this.held && this.point(event));
    for (const name of ["pointerup", "pointercancel"]) root.addEventListener(name, () => (this.held = false));
  }

  drawScale() {
    const [right, top] = [pointOf(0), pointOf(90)];
    const path = `M${right} A${RADIUS} ${RADIUS} 0 0 0 ${top}`;
    this.root.append(svg("path", { d: `M${CENTRE} L${right} A${RADIUS} ${RADIUS} 0 0 0 ${top} Z`, class: "dial-face" }));
    this.root.append(svg("path", { d: path, class: "dial-arc" }), svg("path", { d: path, class: "dial-grasp" }));
    for (let angle = 0; angle <= 90; angle += 5) {
      const long = angle % 15 === 0;
      const [x1, y1] = pointOf(angle, long ? 0.9 : 0.945);
      const [x2, y2] = pointOf(angle, 0.985);
      this.root.append(svg("line", { x1, y1, x2, y2, class: long ? "dial-tick long" : "dial-tick" }));
      if (!long) continue;
      const [x, y] = pointOf(angle, 1.13);
      this.root.append(svg("text", { x, y: y + 4, class: "dial-number" }, `${angle}°`));
    }
    this.root.append(svg("text", { x: CENTRE[0] + 4, y: CENTRE[1] + 17, class: "dial-word" }, "for itself →"));
    const word = svg("text", { x: 0, y: 0, class: "dial-word", transform: `translate(${CENTRE[0] - 10} ${CENTRE[1] - 4}) rotate(-90)` }, "for the others →");
    this.root.append(word);
  }

  /** Show the hands of all twins; that of `chosen` is the one that turns. */
  show(twins, chosen) {
    const { angle, letter } = twins[chosen];
    this.others = twins.filter((_, number) => number !== chosen);
    this.angle = angle;
    this.hands.replaceChildren();
    twins.forEach((twin, number) => number !== chosen && this.hand(twin, false));
    this.hand(twins[chosen], true);
    this.root.setAttribute("aria-valuenow", this.angle);
    this.root.setAttribute("aria-valuetext", `${this.angle} degrees${letter ? `, twin ${letter}` : ""}`);
  }

  hand({ angle, letter, place }, chosen) {
    const [x1, y1] = pointOf(angle, chosen ? 0.12 : 0.6);
    const [x2, y2] = pointOf(angle, 0.84);
    const [cx, cy] = pointOf(angle);
    const kind = `twin-${place}${chosen ? " chosen" : ""}`;
    this.hands.append(svg("line", { x1, y1, x2, y2, class: `dial-hand ${kind}` }));
    this.hands.append(svg("circle", { cx, cy, r: chosen ? 15 : 10, class: `dial-grip ${kind}` }));
    this.hands.append(svg("text", { x: cx, y: cy + (chosen ? 5 : 4), class: `dial-letter ${chosen ? "chosen" : ""}` }, letter));
  }

  /** A finger turns the dial by its arc; elsewhere it scrolls the page. */
  press(event) {
    if (event.pointerType === "touch" && !event.target.matches(".dial-grasp")) return;
    this.held = true;
    this.root.setPointerCapture(event.pointerId);
    this.root.focus({ preventScroll: true });
    const angle = this.angleAt(event);
    const nearest = this.others.find((twin) => Math.abs(twin.angle - angle) < Math.min(GRIP, Math.abs(this.angle - angle)));
    if (nearest) this.chosen(nearest.place);
    else this.point(event);
    event.preventDefault();
  }

  point(event) {
    this.to(this.angleAt(event));
  }

  angleAt(event) {
    const place = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.root.getScreenCTM().inverse());
    const radians = Math.atan2(CENTRE[1] - place.y, place.x - CENTRE[0]);
    return radians < -Math.PI / 2 ? 90 : (radians * 180) / Math.PI;
  }

  key(event) {
    const steps = { ArrowRight: 1, ArrowLeft: -1, ArrowUp: 1, ArrowDown: -1, PageUp: 15, PageDown: -15 };
    const ends = { Home: this.low, End: this.high };
    if (event.key in steps) this.to(this.angle + steps[event.key] * (event.shiftKey ? 5 : 1));
    else if (event.key in ends) this.to(ends[event.key]);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  to(angle) {
    const whole = Math.round(Math.min(Math.max(angle, this.low), this.high));
    if (whole !== this.angle) this.turned(whole);
  }
}
