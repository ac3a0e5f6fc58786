// Sums planes of light, each times its sliders, and shows them as the report shows its frames. Arithmetic only: the planes are made beforehand.
const data = JSON.parse(document.getElementById("live-data").textContent);
const [place, canvas, told] = ["live-controls", "live-picture", "live-told"].map((id) => document.getElementById(id));
const positive = (bits) => (bits >> 10 ? (1 + (bits & 1023) / 1024) * 2 ** ((bits >> 10) - 15) : bits * 2 ** -24);
const half = (bits) => (bits >> 15 ? -positive(bits & 32767) : positive(bits));
const pixels = data.size[0] * data.size[1];
/** Gives the planes their rates: of all halves the high bytes, then the low ones. */
async function unpack() {
  const packed = new Blob([Uint8Array.from(atob(data.values), (letter) => letter.charCodeAt(0))]);
  const bytes = new Uint8Array(await new Response(packed.stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer());
  const length = pixels * data.channels;
  const value = (at) => half((bytes[at] << 8) | bytes[bytes.length / 2 + at]);
  data.planes.forEach((plane, k) => {
    plane.rates = Float32Array.from({ length }, (_, i) => value(k * length + i) * plane.scale);
    plane.light = plane.rates.reduce((a, b) => a + b, 0);
  });
}
let capture = data.captures[data.first];
let now = {};
const encode = (x) => Math.round(255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055));

/** Factor on light of a group that fluoresced twice: the square of that on all its light that fluoresced once. */
function again(group) {
  const once = data.planes.filter((plane) => plane.group === group && plane.fluorophore !== null);
  const seen = once.filter(({ response }) => response === once[0].response);
  const before = seen.reduce((sum, { light }) => sum + light, 0);
  const after = seen.reduce((sum, { light, fluorophore }) => sum + light * now.concentrations[fluorophore], 0);
  return before > 0 ? (after / before) ** 2 : 1;
}

/** Sums of the planes with drives, [channel][pixel], e-/s. */
function sum(drives) {
  const rates = new Float32Array(pixels * data.channels);
  for (const { response, group, fluorophore, is_multiple, rates: own } of data.planes) {
    const factor = drives[group] * (is_multiple ? again(group) : fluorophore === null ? 1 : now.concentrations[fluorophore]);
    if (response !== capture.response || factor === 0) continue;
    for (let i = 0; i < rates.length; i++) rates[i] += factor * own[i];
  }
  return rates;
}

function draw() {
  const { dn_per_electron, white_dn, well_e, dark_e_per_s, matrix, lift, white, is_colored, subtracted } = capture;
  const [rates, ambient] = [sum(now.drives), subtracted && sum(subtracted)];
  const [time, scale] = [now.exposure_s, dn_per_electron * now.gain];
  const picture = new ImageData(...data.size);
  let clipped = 0;
  for (let pixel = 0; pixel < pixels; pixel++) {
    let isFull = false;
    const dn = [0, 1, 2].map((channel) => {
      const at = (channel % data.channels) * pixels + pixel;
      const value = Math.min(Math.min((Math.max(rates[at], 0) + dark_e_per_s) * time, well_e) * scale, white_dn);
      isFull ||= value >= Math.min(white_dn, well_e * scale);
      return value - (ambient ? (ambient[at] + dark_e_per_s) * time * scale : 0);
    });
    clipped += isFull;
    let color = matrix.map((row) => row[0] * dn[0] + row[1] * dn[1] + row[2] * dn[2]);
    if (isFull && is_colored) color = color.fill(Math.max(...color));
    const x = (lift * Math.max(...color, 0)) / white;
    const factor = (lift * (1 + x / (lift * lift))) / (1 + x) / white;
    color.forEach((value, i) => (picture.data[4 * pixel + i] = encode(Math.min(Math.max(value * factor, 0), 1))));
    picture.data[4 * pixel + 3] = 255;
  }
  canvas.getContext("2d").putImageData(picture, 0, 0);
  told.textContent = `${((100 * clipped) / pixels).toFixed(1)} % of the blocks clipped`;
}

/** A slider; logarithmic where it begins above 0. */
function slider(name, unit, value, [low, high], change) {
  const input = Object.assign(document.createElement("input"), { type: "range", min: 0, max: 1000 });
  const shown = document.createElement("output");
  const label = document.createElement("label");
  const at = (step) => (low > 0 ? low * (high / low) ** (step / 1000) : (high * step) / 1000);
  input.value = low > 0 ? (1000 * Math.log(value / low)) / Math.log(high / low) : (1000 * value) / high;
  const tell = (number) => (input.ariaValueText = shown.textContent = `${Number(number.toPrecision(3))} ${unit}`);
  input.oninput = () => (change(at(input.value)), tell(at(input.value)), draw());
  tell(value);
  label.append(`${name} `, input, " ", shown);
  place.append(label);
}

/** Begins anew with a capture as the report has it. */
function begin() {
  now = { ...capture, drives: [...capture.drives], concentrations: Object.fromEntries(data.planes.map(({ fluorophore }) => [fluorophore, 1])) };
  place.replaceChildren();
  data.groups.forEach((group, i) => slider(`Drive of ${group}`, "×", now.drives[i], [0, Math.max(2, 2 * now.drives[i])], (x) => (now.drives[i] = x)));
  slider("Exposure", "ms", 1e3 * now.exposure_s, [Math.min(0.1, 1e3 * now.exposure_s), Math.max(1000, 1e3 * now.exposure_s)], (x) => (now.exposure_s = x / 1e3));
  slider("Gain", "×", now.gain, [Math.min(1, now.gain), Math.max(32, now.gain)], (x) => (now.gain = x));
  for (const name of Object.keys(now.concentrations)) if (name !== "null") slider(name.replaceAll("_", " "), "×", 1, [0, 4], (x) => (now.concentrations[name] = x));
  draw();
}
const choice = document.getElementById("live-capture");
data.captures.forEach(({ name }, i) => choice.add(new Option(name, i, i === data.first, i === data.first)));
choice.onchange = () => ((capture = data.captures[choice.value]), begin());
document.getElementById("live-again").onclick = begin;
unpack().then(begin, () => (told.textContent = "This browser can't unpack the planes of light: it is older than 2023.")).then(() => {
  document.getElementById("live").hidden = false;
});
