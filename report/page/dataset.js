const PAGE = 12;

const index = read("index");
const words = index.words;
let found = [];
let page = 0;

/* ---- the gallery ---- */

/** Whether a subject is of what is chosen: all, a split, all failures, or one kind of them. */
function fits(one, group) {
  if (group === "all" || one.split === group) return true;
  return one.reason !== undefined && (group === "failed" || group === one.what);
}

function choose() {
  const group = at("group").value;
  const asked = at("search").value.trim().toLowerCase();
  const asks = (text) => text !== undefined && text.toLowerCase().includes(asked);
  found = index.subjects.filter(
    (one) => fits(one, group) && (asks(one.id) || asks(one.reason) || asks(one.what)),
  );
  show(0);
}

/** The `number`-th page, or the one nearest to it. */
function show(number) {
  const pages = Math.max(1, Math.ceil(found.length / PAGE));
  page = Math.max(0, Math.min(pages - 1, number));
  const first = page * PAGE;
  const some = found.slice(first, first + PAGE);
  at("cards").replaceChildren(...some.map(card));
  const none = found.length === 0;
  at("where").textContent = none
    ? "no subject"
    : `of ${pages}: subjects ${first + 1} to ${first + some.length} of ${found.length}`;
  at("page").value = page + 1;
  at("page").max = pages;
  at("previous").disabled = page === 0;
  at("next").disabled = page >= pages - 1;
}

function turn(by) {
  show(page + by);
  // The end of the pages takes the focus from no one.
  if (at("next").disabled) at("previous").focus();
  else if (at("previous").disabled) at("next").focus();
  at("gallery").scrollIntoView();
}

function card(one) {
  const header = make("header", {}, make("h3", {}, one.id));
  const article = make("article", { class: "card", "data-subject": one.id }, header);
  if (one.reason !== undefined) {
    header.append(make("span", { class: "bad" }, one.what));
    article.append(make("p", {}, one.reason));
    return article;
  }
  const record = read(one.record);
  const facts = [
    one.split,
    `view ${record.view}, yaw ${record.yaw_deg}°`,
    `silhouette ${record.height_m.toFixed(2)} m high`,
    record.licence,
  ];
  header.append(make("span", { class: "soft" }, facts.join(" · ")));
  const open = make("button", { type: "button", "aria-haspopup": "dialog", "aria-label": `Turn ${one.id} in 3D` }, "Turn in 3D");
  open.addEventListener("click", () => openSolid(one.id, record));
  header.append(open);
  const maps = make("div", { class: "maps" });
  for (const [name, source] of Object.entries(record.pictures)) {
    const picture = make("img", {
      src: source,
      alt: `${one.id}: ${words[name]}`,
      width: record.size[1],
      height: record.size[0],
    });
    maps.append(make("figure", {}, picture, make("figcaption", {}, words[name])));
  }
  article.append(maps);
  if (one.figures) article.append(make("p", { class: "soft" }, one.figures));
  return article;
}

/* ---- one subject in three dimensions ---- */

let solid = null;
let eye; // degrees about and above the subject, and how far away
let drawing = 0; // what was asked for last: pictures take their time to decode

function openSolid(id, record) {
  solid = { id, record };
  eye = { turn: 0, tilt: 4, far: 1.9 };
  at("solid-title").textContent = id;
  tell();
  const kinds = at("kind");
  const has = record.solid.depths;
  for (const option of kinds.options) {
    option.disabled = !option.dataset.needs.split(" ").every((name) => name in has);
  }
  if (kinds.selectedOptions[0].disabled) kinds.value = "surface";
  at("solid-dialog").showModal();
  drawSolid();
}

function depths(record, name) {
  const { rows, columns, near, depths: packed } = record.solid;
  const bytes = Uint8Array.from(atob(packed[name]), (letter) => letter.charCodeAt(0));
  const tenths = new DataView(bytes.buffer);
  const metres = new Float32Array(rows * columns);
  for (let k = 0; k < metres.length; k++) {
    const value = tenths.getUint16(2 * k, true);
    metres[k] = value === 0 ? 0 : near + (value - 1) / 1e4;
  }
  return metres;
}

/** Colours of the picture at the grid's places: [r, g, b] for each. */
async function colours(record, name) {
  const { rows, columns } = record.solid;
  const picture = new Image();
  picture.src = record.pictures[name];
  await picture.decode();
  const canvas = make("canvas", { width: columns, height: rows });
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.drawImage(picture, 0, 0, columns, rows);
  return context.getImageData(0, 0, columns, rows).data;
}

/** The vertices of a depth map: x right, y up, z to the viewer, metres. */
function points(record, depth) {
  const { rows, columns, spacing, near } = record.solid;
  const result = { x: [], y: [], z: [], place: new Int32Array(depth.length).fill(-1), cells: [] };
  for (let k = 0; k < depth.length; k++) {
    if (depth[k] === 0) continue;
    result.place[k] = result.x.length;
    result.x.push(((k % columns) - columns / 2) * spacing);
    result.y.push((rows / 2 - Math.floor(k / columns)) * spacing);
    result.z.push(near - depth[k]);
    result.cells.push(k);
  }
  return result;
}

/** Two triangles between four neighbours, where no edge bridges a gap in depth. */
function triangles(record, depth, vertices) {
  const { rows, columns } = record.solid;
  const faces = { i: [], j: [], k: [] };
  const gap = 0.06;
  for (let row = 0; row + 1 < rows; row++) {
    for (let column = 0; column + 1 < columns; column++) {
      const a = row * columns + column;
      const corners = [a, a + 1, a + columns, a + columns + 1];
      const d = corners.map((c) => depth[c]);
      if (d.includes(0) || Math.max(...d) - Math.min(...d) > gap) continue;
      const [p, q, r, s] = corners.map((c) => vertices.place[c]);
      faces.i.push(p, q);
      faces.j.push(r, r);
      faces.k.push(q, s);
    }
  }
  return faces;
}

async function mesh(record, depthName, pictureName, name) {
  const depth = depths(record, depthName);
  const vertices = points(record, depth);
  const trace = {
    type: "mesh3d",
    name,
    x: vertices.x,
    y: vertices.z.map((z) => -z),
    z: vertices.y,
    ...triangles(record, depth, vertices),
    hoverinfo: "skip",
    lighting: { ambient: 0.55, diffuse: 0.6, specular: 0.05, roughness: 0.9 },
    lightposition: { x: 100, y: -200, z: 200 },
  };
  if (pictureName) {
    const pixels = await colours(record, pictureName);
    trace.vertexcolor = vertices.cells.map(
      (k) => `rgb(${pixels[4 * k]},${pixels[4 * k + 1]},${pixels[4 * k + 2]})`,
    );
  } else {
    trace.color = "#b9c2cc";
  }
  return trace;
}

async function drawSolid() {
  const kind = at("kind").value;
  const { id, record } = solid;
  const mine = ++drawing;
  let traces;
  if (kind === "sensor") {
    const vertices = points(record, depths(record, "sensor"));
    traces = [
      {
        type: "scatter3d",
        mode: "markers",
        name: "sensor",
        x: vertices.x,
        y: vertices.z.map((z) => -z),
        z: vertices.y,
        marker: { size: 1.6, color: vertices.z, colorscale: "Viridis" },
        hoverinfo: "skip",
      },
    ];
  } else if (kind === "body") {
    traces = [
      await mesh(record, "body_front", null, "body, front"),
      await mesh(record, "body_back", null, "body, back"),
    ];
  } else {
    traces = [
      await mesh(record, "front", "rgb_front", "front"),
      await mesh(record, "back", "rgb_back", "back"),
    ];
  }
  if (mine !== drawing || !at("solid-dialog").open) return;
  const axis = { visible: false };
  const layout = {
    margin: { l: 0, r: 0, t: 0, b: 0 },
    showlegend: false,
    uirevision: id,
    scene: {
      xaxis: axis,
      yaxis: axis,
      zaxis: axis,
      aspectmode: "manual",
      aspectratio: proportions(traces),
      camera: camera(),
    },
  };
  await plotly().react("solid", traces, layout, BARE);
  if (mine !== drawing || !at("solid-dialog").open) return;
  if (!at("solid").dataset.drawn) {
    at("solid").on("plotly_relayout", (change) => {
      if (change["scene.camera"]) follow(change["scene.camera"]);
    });
  }
  at("solid").dataset.drawn = `${id} ${kind}`;
}

/** Sides of the box that holds all, the longest as long as the view is high. */
function proportions(traces) {
  const sides = ["x", "y", "z"].map((name) => {
    let low = Infinity;
    let high = -Infinity;
    for (const trace of traces) {
      for (const value of trace[name]) {
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
    return Math.max(high - low, 0.01);
  });
  const longest = Math.max(...sides);
  const [x, y, z] = sides.map((side) => (1.5 * side) / longest);
  return { x, y, z };
}

/** The viewer, before the front where nothing is turned, looking at the middle. */
function camera() {
  const [turn, tilt] = [eye.turn, eye.tilt].map((angle) => (angle * Math.PI) / 180);
  const across = eye.far * Math.cos(tilt);
  return {
    eye: { x: across * Math.sin(turn), y: -across * Math.cos(turn), z: eye.far * Math.sin(tilt) },
    center: { x: 0, y: 0, z: 0 },
    up: { x: 0, y: 0, z: 1 },
  };
}

/** A value that keys move between `low` and `high`; the mouse may have brought it beyond. */
function within(value, old, low, high) {
  return Math.max(Math.min(low, old), Math.min(Math.max(high, old), value));
}

function moveSolid(turn, tilt, nearer) {
  if (!at("solid").dataset.drawn) return;
  eye.turn = (eye.turn + turn + 360) % 360;
  eye.tilt = within(eye.tilt + tilt, eye.tilt, -80, 80);
  eye.far = within(eye.far / nearer, eye.far, 0.6, 4);
  plotly().relayout("solid", { "scene.camera": camera() });
  tell();
}

/** Where the mouse has brought the viewer: keys and buttons go on from there. */
function follow({ eye: { x, y, z }, center }) {
  const [right, ahead, up] = [x - center.x, y - center.y, z - center.z];
  eye.far = Math.hypot(right, ahead, up);
  eye.tilt = (Math.asin(up / eye.far) * 180) / Math.PI;
  eye.turn = ((Math.atan2(right, -ahead) * 180) / Math.PI + 360) % 360;
  tell();
}

function tell() {
  const [turn, tilt] = [eye.turn, eye.tilt].map(Math.round);
  at("solid").dataset.eye = `${turn} ${tilt} ${eye.far.toFixed(2)}`;
  at("seen").textContent = `turned ${turn}°, seen from ${Math.abs(tilt)}° ${tilt < 0 ? "below" : "above"}`;
}

/** What a key or a button does: degrees about, degrees above, how much nearer. */
const MOVES = {
  ArrowLeft: [-30, 0, 1],
  ArrowRight: [30, 0, 1],
  ArrowUp: [0, 20, 1],
  ArrowDown: [0, -20, 1],
  "+": [0, 0, 1.25],
  "-": [0, 0, 0.8],
};

/* ---- histograms ---- */

function bars(id, values, first, width, title, unit, curve) {
  const whole = values.reduce((sum, value) => sum + value, 0) || 1;
  let from = values.findIndex((value) => value > 0);
  let to = values.length - 1;
  while (to > from && values[to] === 0) to--;
  if (from < 0) from = to = 0;
  const x = [];
  const y = [];
  for (let k = from; k <= to; k++) {
    x.push(first + (k + 0.5) * width);
    y.push(values[k] / whole / width);
  }
  const traces = [{ type: "bar", x, y, width, marker: { color: "#7aa2cf" }, name: "seen" }];
  if (curve) traces.push({ type: "scatter", mode: "lines", x, y: x.map(curve), line: { color: "#a4262c" }, name: "the model" });
  plot(id, traces, title, unit, "density", {
    bargap: 0,
    showlegend: Boolean(curve),
    legend: { x: 0.99, xanchor: "right", y: 0.99 },
  });
}

function drawHistograms() {
  for (const one of index.histograms) {
    const curve = one.normal && ((x) => Math.exp((-x * x) / 2) / Math.sqrt(2 * Math.PI));
    bars(`histogram-${one.name}`, one.values, one.first, one.width, one.title, one.unit, curve);
  }
}

/* ---- all together ---- */

at("group").addEventListener("change", choose);
at("search").addEventListener("input", choose);
at("page").addEventListener("change", () => show((Number.parseInt(at("page").value) || 1) - 1));
at("previous").addEventListener("click", () => turn(-1));
at("next").addEventListener("click", () => turn(1));
at("kind").addEventListener("change", drawSolid);
for (const button of document.querySelectorAll("[data-move]")) {
  button.addEventListener("click", () => moveSolid(...MOVES[button.dataset.move]));
}
// Before plotly, which tells of a wheel's step only with the next one.
at("solid").addEventListener(
  "wheel",
  (event) => {
    event.preventDefault();
    event.stopPropagation();
    moveSolid(0, 0, Math.exp(-Math.max(-100, Math.min(100, event.deltaY)) / 400));
  },
  { capture: true, passive: false },
);
at("solid").addEventListener("keydown", (event) => {
  const move = MOVES[event.key];
  if (!move || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  moveSolid(...move);
});
at("close").addEventListener("click", () => at("solid-dialog").close());
at("solid-dialog").addEventListener("close", () => {
  drawing++;
  if (at("solid").dataset.drawn) plotly().purge("solid");
  delete at("solid").dataset.drawn;
});
choose();

new IntersectionObserver((entries, observer) => {
  if (entries.some((entry) => entry.isIntersecting)) {
    observer.disconnect();
    drawHistograms();
  }
}).observe(at("histograms"));
