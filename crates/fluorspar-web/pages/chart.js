// Curves over wavelength as a drawing, with the same numbers as a table below it.
// @ts-check

/** @typedef {{wavelength_nm: number[], total: number[], parts: [string, number[]][], pixels: number}} Spectra */

/** Colors by Okabe and Ito, told apart with any color vision, and dashes for those who print in gray. */
const INKS = ["#e69f00", "#56b4e9", "#009e73", "#cc79a7", "#d55e00", "#0072b2", "#b8a800", "#8f8f8f"];
const DASHES = ["", "8 3", "2 2", "9 3 2 3", "5 5", "14 3", "1 3"];
const HEIGHT = 280;
/** Share of the largest value below which a curve is left to the table. */
const SEEN = 0.005;
const MARGIN = { left: 58, right: 12, top: 12, bottom: 40 };

/** @param {string} name @param {Record<string, string | number>} attributes @param {string} [text] */
export function svg(name, attributes, text) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
  if (text !== undefined) element.textContent = text;
  return element;
}

/** A step of 1, 2 or 5 times a power of ten that cuts a length into about five. @param {number} length */
export function niceStep(length) {
  const rough = length / 5;
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * ([1, 2, 5].find((factor) => factor * power >= rough) ?? 10);
}

/** @param {number} value */
export function shortNumber(value) {
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e-3 && size < 1e6) return Number(value.toPrecision(3)).toString();
  const [digits, power] = value.toExponential(2).split("e");
  return `${Number(digits)}·10${[...String(Number(power))].map((c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]).join("")}`;
}

/** @param {Spectra} spectra @param {boolean} hasReflected whether light that was merely reflected is drawn, too
 * @param {number} room width of its place, px */
export function chart(spectra, hasReflected, room) {
  const peak = (/** @type {[string, number[]]} */ [, values]) => Math.max(...values);
  /** @type {[string, number[], number][]} each with the number of its look, which it keeps */
  const looked = spectra.parts.map(([name, values], index) => [name, values, index]);
  const shown = looked.filter(([name]) => hasReflected || name !== "reflected");
  const top = Math.max(...shown.map(([name, values]) => peak([name, values])), hasReflected ? Math.max(...spectra.total) : 0, 1e-30);
  const seen = shown.filter(([name, values]) => peak([name, values]) > SEEN * top);
  /** @type {[string, number[], number][]} */
  const curves = hasReflected ? [["all", spectra.total, -1], ...seen] : seen;
  const nm = spectra.wavelength_nm;
  const [width, height] = [Math.min(Math.max(room, 280), 760), HEIGHT];
  const step = niceStep(top);
  const full = Math.ceil(top / step) * step;
  const [first, last] = [nm[0], nm[nm.length - 1]];
  const x = (/** @type {number} */ at) => MARGIN.left + ((at - first) / (last - first)) * (width - MARGIN.left - MARGIN.right);
  const y = (/** @type {number} */ at) => height - MARGIN.bottom - (at / full) * (height - MARGIN.top - MARGIN.bottom);
  const drawing = svg("svg", { viewBox: `0 0 ${width} ${height}`, width, height, role: "img", class: "chart",
    "aria-label": "Mean spectral radiance of the region by origin; the table below has its numbers" });
  for (let value = 0; value <= full * 1.0001; value += step) {
    drawing.append(svg("line", { x1: MARGIN.left, x2: width - MARGIN.right, y1: y(value), y2: y(value), class: "grid" }));
    drawing.append(svg("text", { x: MARGIN.left - 6, y: y(value) + 4, class: "tick", "text-anchor": "end" }, shortNumber(value)));
  }
  const across = width < 420 ? 100 : 50;
  for (let at = Math.ceil(first / across) * across; at <= last; at += across) {
    drawing.append(svg("line", { x1: x(at), x2: x(at), y1: MARGIN.top, y2: height - MARGIN.bottom, class: "grid" }));
    drawing.append(svg("text", { x: x(at), y: height - MARGIN.bottom + 16, class: "tick", "text-anchor": "middle" }, String(at)));
  }
  drawing.append(svg("text", { x: width - MARGIN.right, y: height - 4, class: "tick", "text-anchor": "end" }, "wavelength, nm"));
  const legend = document.createElement("ul");
  legend.className = "legend";
  curves.forEach(([name, values, index]) => {
    const points = values.map((value, i) => `${x(nm[i]).toFixed(1)},${y(Math.max(value, 0)).toFixed(1)}`);
    const isTotal = index < 0;
    /** @type {Record<string, string>} */
    const look = isTotal ? { class: "total" } : { stroke: INKS[index % INKS.length], "stroke-dasharray": DASHES[index % DASHES.length] };
    drawing.append(svg("polyline", { points: points.join(" "), fill: "none", "stroke-width": isTotal ? 2.5 : 2, ...look }));
    const entry = document.createElement("li");
    const mark = svg("svg", { viewBox: "0 0 28 8", width: 28, height: 8, "aria-hidden": "true" });
    mark.append(svg("line", { x1: 0, x2: 28, y1: 4, y2: 4, "stroke-width": 2.5, ...look }));
    entry.append(mark, name.replaceAll("_", " "));
    legend.append(entry);
  });
  if (seen.length < shown.length) legend.append(Object.assign(document.createElement("li"), { textContent: `${shown.length - seen.length} more below ${100 * SEEN} % of the top` }));
  const figure = document.createElement("figure");
  const caption = document.createElement("figcaption");
  caption.textContent = `Spectral radiance, W/(sr m² nm), mean of ${spectra.pixels} pixels of the render`;
  figure.append(caption, drawing, legend, table(spectra));
  return figure;
}

/** @param {Spectra} spectra */
function table(spectra) {
  const details = document.createElement("details");
  const summary = document.createElement("summary");
  summary.textContent = "Numbers";
  const frame = document.createElement("div");
  frame.className = "scroll";
  frame.tabIndex = 0;
  frame.setAttribute("role", "group");
  frame.setAttribute("aria-label", "Numbers of the spectra");
  details.append(summary, frame);
  details.addEventListener("toggle", () => {
    if (!details.open || frame.firstChild) return;
    const rows = document.createElement("table");
    const head = rows.createTHead().insertRow();
    for (const name of ["nm", "all", ...spectra.parts.map(([name]) => name.replaceAll("_", " "))]) {
      const cell = document.createElement("th");
      cell.scope = "col";
      cell.textContent = name;
      head.append(cell);
    }
    const body = rows.createTBody();
    spectra.wavelength_nm.forEach((nm, i) => {
      const row = body.insertRow();
      for (const value of [nm, spectra.total[i], ...spectra.parts.map(([, values]) => values[i])]) {
        row.insertCell().textContent = value === nm ? String(nm) : value.toExponential(3);
      }
    });
    frame.append(rows);
  });
  return details;
}
