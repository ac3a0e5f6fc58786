// Controls of what can be changed, made from what the server tells of each: path, unit, range, value.
// @ts-check
import { shortNumber } from "./chart.js";

/** @typedef {import("./changes.js").Changes} Changes */
/** @typedef {{path: string, label: string, unit: string, note: string, kind: "number" | "choice", value: any, range: [number, number],
 *   is_log: boolean, auto?: boolean, template?: string, options: {value: string, title: string}[]}} Control */
/** @typedef {{title: string, capture: string | null, controls: Control[]}} ControlGroup */

const STEPS = 1000;
let serial = 0;

/** @param {string} name @param {Record<string, any>} [properties] @param {(Node | string)[]} [children] */
export function make(name, properties = {}, children = []) {
  const element = Object.assign(document.createElement(name), properties);
  element.append(...children);
  return element;
}

/** A number as TOML wants it: with a point. @param {number} value */
function toml(value) {
  const text = String(Number(value.toPrecision(4)));
  return /[.e]/.test(text) ? text : `${text}.0`;
}

/** Where a value stands on a slider. @param {Control} control @param {number} value */
function toSlider({ range: [low, high], is_log }, value) {
  const share = is_log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
  return Math.round(STEPS * Math.min(Math.max(share, 0), 1));
}

/** @param {Control} control @param {number} place */
function fromSlider({ range: [low, high], is_log }, place) {
  const share = place / STEPS;
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
  const slider = make("input", { type: "range", id, min: 0, max: STEPS, step: 1 });
  const field = make("input", { type: "number", step: "any", min: low, max: high, className: "value" });
  field.setAttribute("aria-label", `${control.label}, ${control.unit}`);
  const back = backButton(control, changes);
  const write = (/** @type {number} */ value) => {
    if (!Number.isFinite(value)) return;
    changes.set(control.path, control.template ? control.template.replace("$", toml(value)) : toml(value));
  };
  slider.addEventListener("pointerdown", () => drag.begin());
  slider.addEventListener("keydown", () => changes.remember(control.path));
  slider.addEventListener("input", () => write(fromSlider(control, Number(slider.value))));
  slider.addEventListener("change", () => drag.end());
  field.addEventListener("change", () => {
    changes.remember();
    write(Math.min(Math.max(Number(field.value), control.is_log ? Number.MIN_VALUE : low), 1e6));
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
      field.value = String(Number(value.toPrecision(4)));
      slider.setAttribute("aria-valuetext", `${shortNumber(value)} ${control.unit}`);
    } else field.value = "";
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
    const own = group.controls.map((control) =>
      control.kind === "number" ? numberControl(control, changes, drag) : choiceControl(control, changes));
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
