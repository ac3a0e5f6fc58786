// Controls of what can be changed, made from what the server tells of each: path, unit, range, value.
// @ts-check
import { shortNumber } from "./chart.js";

/** @typedef {import("./changes.js").Changes} Changes */
/** @typedef {{path: string, label: string, unit: string, note: string, kind: "number" | "choice" | "record", value: any,
 *   range: [number, number], is_log: boolean, is_whole: boolean, auto?: boolean, template?: string,
 *   options: {value: string, title: string}[], fields: Control[]}} Control */
/** @typedef {{title: string, capture: string | null, controls: Control[]}} ControlGroup */

const STEPS = 1000;
/** Largest number of a person. */
const MOST_WHOLE = 4e9;
let serial = 0;

/** @param {string} name @param {Record<string, any>} [properties] @param {(Node | string)[]} [children] */
export function make(name, properties = {}, children = []) {
  const element = Object.assign(document.createElement(name), properties);
  element.append(...children);
  return element;
}

/** A number as TOML wants it: with a point, unless it is whole. @param {Control} control @param {number} value */
function toml(control, value) {
  if (control.is_whole) return String(Math.round(value));
  const text = String(Number(value.toPrecision(9)));
  return /[.e]/.test(text) ? text : `${text}.0`;
}

/** Steps of a slider. @param {Control} control */
const stepsOf = ({ range: [low, high], is_whole }) => (is_whole ? high - low : STEPS);

/** Where a value stands on a slider. @param {Control} control @param {number} value */
function toSlider(control, value) {
  const { range: [low, high], is_log } = control;
  const share = is_log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
  return Math.round(stepsOf(control) * Math.min(Math.max(share, 0), 1));
}

/** @param {Control} control @param {number} place */
function fromSlider(control, place) {
  const { range: [low, high], is_log } = control;
  const share = place / stepsOf(control);
  return Number((is_log ? low * (high / low) ** share : low + (high - low) * share).toPrecision(3));
}

/** The value of a control: its change, else that of the experiment; `null` is automatic.
 * @param {Control} control @param {Changes} changes @returns {number | null} */
function numberOf(control, changes) {
  const text = changes.value(control.path);
  if (text === undefined) return control.value;
  if (text.includes("auto")) return null;
  const at = control.template ? control.template.indexOf("$") : 0;
  return Number.parseFloat(text.slice(at));
}

/** @param {Control} control @param {Changes} changes @param {Drag} drag */
function numberControl(control, changes, drag) {
  const id = `control-${serial++}`;
  const [low, high] = control.range;
  const slider = make("input", { type: "range", id, min: 0, max: stepsOf(control), step: 1 });
  const field = make("input", { type: "number", step: control.is_whole ? 1 : "any", min: low, max: control.is_whole ? MOST_WHOLE : high, className: "value" });
  field.setAttribute("aria-label", `${control.label}, ${control.unit}`);
  const back = backButton(control, changes);
  const write = (/** @type {number} */ value) => {
    if (!Number.isFinite(value)) return;
    changes.set(control.path, control.template ? control.template.replace("$", toml(control, value)) : toml(control, value));
  };
  let isDragged = false;
  const end = () => {
    if (isDragged) drag.end();
    isDragged = false;
  };
  slider.addEventListener("pointerdown", () => {
    isDragged = true;
    drag.begin();
    for (const event of ["pointerup", "pointercancel"]) window.addEventListener(event, end, { once: true });
  });
  slider.addEventListener("input", () => {
    // Keys move it, too
    if (!isDragged) changes.remember(control.path);
    write(fromSlider(control, Number(slider.value)));
  });
  slider.addEventListener("change", end);
  field.addEventListener("change", () => {
    if (field.value === "") return update();
    changes.remember();
    write(Math.min(Math.max(Number(field.value), control.is_log ? Number.MIN_VALUE : low), control.is_whole ? MOST_WHOLE : 1e6));
  });
  const label = make("label", { htmlFor: id, textContent: control.label });
  const row = make("div", { className: "row" }, [slider, field, make("span", { className: "unit", textContent: control.unit }), back]);
  const auto = control.auto === undefined ? null : make("input", { type: "checkbox" });
  auto?.addEventListener("change", () => {
    changes.remember();
    if (auto.checked) changes.set(control.path, '"auto"');
    else write(control.value ?? drag.lastExposure ?? Math.sqrt(low * high));
  });
  const head = make("div", { className: "head" }, [label]);
  if (auto) head.append(make("label", { className: "auto" }, [auto, "auto"]));
  const update = () => {
    const value = numberOf(control, changes);
    slider.disabled = field.disabled = value === null && auto !== null;
    if (auto) auto.checked = value === null;
    if (value !== null) {
      if (document.activeElement !== slider || Math.abs(fromSlider(control, Number(slider.value)) - value) > 1e-3 * Math.abs(value))
        slider.value = String(toSlider(control, value));
      field.value = control.is_whole ? String(value) : String(Number(value.toPrecision(6)));
      slider.setAttribute("aria-valuetext", `${shortNumber(value)} ${control.unit}`);
    } else {
      field.value = "";
      if (!auto) [slider.value, field.placeholder] = ["0", "none"];
    }
    back.hidden = changes.value(control.path) === undefined;
  };
  return { element: make("div", { className: "control" }, [head, row, noteOf(control, control.range)]), update };
}

/** @param {Control} control @param {Changes} changes */
function choiceControl(control, changes) {
  const id = `control-${serial++}`;
  const list = make("select", { id });
  for (const { value, title } of control.options) list.append(make("option", { value, textContent: title }));
  const back = backButton(control, changes);
  list.addEventListener("change", () => {
    changes.remember();
    changes.set(control.path, list.value === control.value ? undefined : list.value);
  });
  const update = () => {
    const value = changes.value(control.path) ?? control.value;
    if (![...list.options].some((option) => option.value === value)) list.append(make("option", { value, textContent: value }));
    list.value = value;
    back.hidden = changes.value(control.path) === undefined;
  };
  const head = make("div", { className: "head" }, [make("label", { htmlFor: id, textContent: control.label })]);
  return { element: make("div", { className: "control" }, [head, make("div", { className: "row" }, [list, back]), noteOf(control)]), update };
}

/** Several values within one: a switch, and controls of each. @param {Control} control @param {Changes} changes @param {Drag} drag */
function recordControl(control, changes, drag) {
  const template = control.template ?? "";
  const pattern = new RegExp(`^${template.replace(/[[\]{}.]/g, "\\$&").replace(/\$\w+/g, "(.+?)")}$`);
  const order = [...template.matchAll(/\$(\w+)/g)].map((found) => found[1]);
  const text = () => changes.value(control.path) ?? control.value;
  /** @returns {Record<string, string>} */
  const values = () => Object.fromEntries((pattern.exec(text() ?? "") ?? []).slice(1).map((value, i) => [order[i], value]));
  const usual = Object.fromEntries(control.fields.map((field) => [field.path, field.kind === "number" ? toml(field, field.value) : field.value]));
  const write = (/** @type {Record<string, string>} */ now) =>
    changes.set(control.path, template.replace(/\$(\w+)/g, (_, name) => now[name] ?? usual[name]));
  const within = /** @type {any} */ ({
    remember: (/** @type {string} */ what) => changes.remember(what && control.path + what),
    value: (/** @type {string} */ name) => values()[name] === usual[name] ? undefined : values()[name],
    set: (/** @type {string} */ name, /** @type {string} */ value) => write({ ...values(), [name]: value ?? usual[name] }),
  });
  const own = control.fields.map((field) => drawControl(field, within, drag));
  const box = make("div", { className: "record" }, own.map((field) => field.element));
  const isOn = make("input", { type: "checkbox" });
  isOn.addEventListener("change", () => {
    changes.remember();
    if (isOn.checked) write({});
    else changes.set(control.path, undefined);
  });
  const update = () => {
    isOn.checked = typeof text() === "string";
    isOn.disabled = control.value !== null;
    box.hidden = !isOn.checked;
    if (isOn.checked) for (const field of own) field.update();
  };
  const head = make("label", { className: "auto" }, [isOn, control.label]);
  return { element: make("div", { className: "control" }, [head, noteOf(control), box]), update };
}

/** @param {Control} control @param {Changes} changes @param {Drag} drag @returns {{element: HTMLElement, update: () => void}} */
function drawControl(control, changes, drag) {
  if (control.kind === "record") return recordControl(control, changes, drag);
  return control.kind === "number" ? numberControl(control, changes, drag) : choiceControl(control, changes);
}

/** @param {Control} control @param {Changes} changes */
function backButton(control, changes) {
  const back = make("button", { type: "button", className: "back", textContent: "↺", title: "As in the experiment" });
  back.setAttribute("aria-label", `${control.label}: as in the experiment`);
  back.addEventListener("click", () => {
    changes.remember();
    changes.set(control.path, undefined);
  });
  return back;
}

/** @param {Control} control @param {number[]} [range] */
function noteOf(control, range) {
  const told = [control.note, range ? `${shortNumber(range[0])} to ${shortNumber(range[1])}${control.unit === "×" ? " ×" : ` ${control.unit}`}` : ""];
  const text = told.filter((part) => part).join("; ");
  return make("p", { className: "note" }, [make("code", { textContent: control.path }), text ? ` ${text}` : ""]);
}

/** @typedef {{begin: () => void, end: () => void, lastExposure: number | null}} Drag */

/** Draws the controls of groups; returns what brings them up to date.
 * @param {HTMLElement} place @param {ControlGroup[]} groups @param {Changes} changes @param {Drag} drag */
export function drawControls(place, groups, changes, drag) {
  const drawn = groups.map((group) => {
    const own = group.controls.map((control) => drawControl(control, changes, drag));
    const element = make("details", { className: "group", open: true },
      [make("summary", { textContent: group.title }), ...own.map((control) => control.element)]);
    return { group, own, element };
  });
  place.replaceChildren(...drawn.map(({ element }) => element));
  return () => {
    for (const { group, own, element } of drawn) {
      element.hidden = group.capture !== null && group.capture !== changes.shown.capture;
      for (const control of own) control.update();
    }
  };
}
