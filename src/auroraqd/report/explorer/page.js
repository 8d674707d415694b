/* The explorer's page: what happens when skills are pointed at, clicked, selected or sought.
 *
 * Bokeh draws, and keeps what is selected; it calls `start` with its figures and the data (see runs.py and figures.py), and
 * `move` and `tap` when that happens on a map. A skill is named by its run and its index there. All texts from the
 * data go through `textContent`, so nothing in them can run. */
window.explorer = (() => {
  const PINS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00"]; // Okabe and Ito: for the colour-blind too
  const NEAR = 14; // pixels within which a click means a skill
  const LINES = 300, PICTURES = 48, FOUND = 12, ANCESTORS = 50; // that are shown of a set; that are found; on the maps
  const $ = (id) => document.getElementById(id);
  const EVERY = 2000, REST = 10; // milliseconds between two looks at a run; times that a page is there for what it took to come
  const KEPT = "explorer"; // in the session of the browser
  const state = { run: 0, skill: -1, place: null, pins: [], set: null, playing: null, moment: null, film: null, filming: false };
  let models, data, maps, ink, shaded = null;

  // Tables: rows of numbers in few bytes.
  const TYPES = { uint8: Uint8Array, int8: Int8Array, uint16: Uint16Array, int32: Int32Array, uint32: Uint32Array, float32: Float32Array, float64: Float64Array };
  const bytesOf = (text) => Uint8Array.fromBase64?.(text) ?? Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

  /** What was packed (tables.py), as arrays. */
  function unpacked(value) {
    if (Array.isArray(value)) return value.map(unpacked);
    if (value === null || typeof value !== "object" || ArrayBuffer.isView(value)) return value;
    if (typeof value.base64 === "string") return Object.assign(new TYPES[value.dtype](bytesOf(value.base64).buffer), { shape: value.shape });
    return Object.fromEntries(Object.entries(value).map(([name, each]) => [name, unpacked(each)]));
  }

  const width = (table) => table.values.shape[1];
  const entry = (table, i, j) => {
    const value = table.values[i * width(table) + j];
    return table.low ? table.low[j] + table.step[j] * value : value;
  };
  const rowOf = (table, i) => Float64Array.from({ length: width(table) }, (_, j) => entry(table, i, j));

  /** A column of a space: one of its own, or after these the two along which it varies most. */
  function column(run, space, j) {
    const { names, table, main } = run.spaces[space];
    const read = j < names.length ? (i) => entry(table, i, j) : (i) => main[2 * i + j - names.length];
    return Float32Array.from({ length: run.rows.length }, (_, i) => read(i));
  }

  const columnNames = ({ names, main }) => [...names, ...(main ? ["main axis 1", "main axis 2"] : [])];

  // What the learned descriptor expects.
  function decoded({ decoder }, place) {
    if (decoder.kind === "affine") {
      const { matrix, middle } = decoder, n = matrix.shape[1];
      return Float64Array.from({ length: n }, (_, j) =>
        middle.reduce((sum, at, k) => sum + (place[k] - at) * matrix[(k + 1) * n + j], matrix[j]));
    }
    const { low, high, side, table } = decoder, result = new Float64Array(width(table));
    const at = low.map((from, k) => Math.min(Math.max((place[k] - from) / (high[k] - from), 0), 1) * (side - 1));
    for (let corner = 0; corner < 2 ** at.length; corner++) { // linear between the samples around
      let weight = 1, index = 0;
      at.forEach((value, k) => {
        const before = Math.min(Math.floor(value), side - 2), after = (corner >> k) & 1;
        weight *= after ? value - before : 1 - (value - before);
        index = index * side + before + after;
      });
      if (weight > 0) result.forEach((_, j) => { result[j] += weight * entry(table, index, j); });
    }
    return result;
  }

  function reconstruction(run, i) {
    if (run.differences) {
      return rowOf(run.observed, i).map((value, j) => value + entry(run.differences, i, j));
    }
    return run.decoder ? decoded(run, rowOf(run.spaces.descriptor.table, i)) : null;
  }

  // Maps.
  const rendererOf = (figure, name) => figure.renderers.find((renderer) => renderer.name === name);
  const rows = (columns) => Object.values(columns)[0].length;
  const append = (columns, row) => { Object.values(columns).forEach((values, k) => { values.push(row[k]); }); };

  function fill(figure, name, columns) {
    const source = rendererOf(figure, name).data_source;
    if (rows(columns) || rows(source.data)) source.data = columns; // each change costs a frame some milliseconds
  }

  const shownOn = (map) => (state.moment ? models.then : models.sources[map.run]).data;

  /** Where a skill is on a map; NaN where it was not there at the time that is shown. */
  function placeOn(map, i) {
    const row = state.moment ? rowThen(data.runs[map.run].id[i]) : i;
    return ["x", "y"].map((axis) => shownOn(map)[`${map.space}_${axis}`][row] ?? NaN);
  }

  /** The skill that is nearest to a place of a map in pixels, of those that are `among`, and how far it is. */
  function nearest(map, x, y, among = () => true) {
    const { x_range, y_range, inner_width, inner_height } = map.figure;
    const [across, up] = [inner_width / (x_range.end - x_range.start), inner_height / (y_range.end - y_range.start)];
    const source = shownOn(map), xs = source[`${map.space}_x`], ys = source[`${map.space}_y`];
    let best = -1, least = Infinity;
    for (let i = 0; i < xs.length; i++) {
      const dx = (xs[i] - x) * across, dy = (ys[i] - y) * up, distance = dx * dx + dy * dy;
      if (distance < least && among(dx, dy, i)) { best = i; least = distance; }
    }
    return { skill: state.moment ? skillOf(data.runs[map.run], state.moment.id[best]) : best, distance: Math.sqrt(least) };
  }

  function setAxes(map) {
    const source = models.sources[map.run], run = data.runs[map.run], [x, y] = map.shown;
    const names = columnNames(run.spaces[map.space]);
    const constant = new Float32Array(run.rows.length); // of a space of one dimension
    const second = names.length > 1 ? column(run, map.space, y) : constant;
    source.data = { ...source.data, [`${map.space}_x`]: column(run, map.space, x), [`${map.space}_y`]: second };
    label(map);
    mark();
  }

  function label({ run, space, figure, shown }) {
    let [x, y] = shown;
    const names = columnNames(data.runs[run].spaces[space]);
    if (state.moment) [x, y] = data.runs[run].spaces[space].shown;
    figure.below[0].axis_label = names[x];
    figure.left[0].axis_label = names.length > 1 ? names[y] : "";
  }

  /** What skills can be coloured by: name to a function from runs to their numbers; null for the place. */
  function colourings() {
    const found = new Map([[`place in ${data.runs[0].placed}`, null]]);
    for (const name of Object.keys(data.runs[0].values)) found.set(name, (run) => run.values[name]);
    for (const [space, { names }] of Object.entries(data.runs[0].spaces)) {
      names.forEach((name, j) => { found.set(free(found, name, space), (run) => column(run, space, j)); });
    }
    return found;
  }

  /** The name of a column of a space, and of which space it is where others have that name: genes are called as their task likes. */
  function free(taken, name, space) {
    let found = name;
    while (taken.has(found)) found += { descriptor: " (descriptor)", truth: " (ground truth)", genes: " (gene)" }[space];
    return found;
  }

  function colour(read) {
    const values = data.runs.map((run) => (read ? read(run) : null));
    let low = Infinity, high = -Infinity;
    for (const each of values) for (const value of each ?? []) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
    const { colors, bar, palette, sources } = models, span = high > low ? high - low : 1;
    bar.visible = read !== null;
    if (read && low <= high) colors.setv({ low, high: low + span });
    sources.forEach((source, k) => {
      const shades = source.data.color; // its kind of array says that these are colours
      values[k]?.forEach((value, i) => { shades[i] = !Number.isNaN(value) ? palette[Math.round(255 * (value - low) / span)] : 0x888888ff; });
      if (!read) shades.set(data.runs[k].place);
      source.change.emit();
    });
    shaded = read;
    if (state.moment) models.then.data = { ...models.then.data, color: coloursThen() };
    drawSet();
  }

  /** Rings and dots above the maps: what is pointed at, its ancestors, what is pinned or has a film, and the place that was clicked.
   *
   * They are a picture of their own above each map, for they change with each move: the browser draws what has changed, and
   * Bokeh nothing. */
  function mark() {
    maps.forEach(markOn);
  }

  function markOn(map) {
    const { frame } = map.view, { left, top, width: wide, height } = frame.bbox, run = data.runs[map.run];
    const shapes = [], on = ([x, y]) => [frame.x_scale.compute(x) - left, frame.y_scale.compute(y) - top];
    const add = (kind, attributes) => {
      if (Object.values(attributes).some(Number.isNaN)) return; // it was not there then
      const shape = document.createElementNS(map.marks.namespaceURI, kind);
      for (const [name, value] of Object.entries(attributes)) shape.setAttribute(name, value);
      shapes.push(shape);
    };
    const dot = (place, r, look, more = {}) => { const [cx, cy] = on(place); add("circle", { cx, cy, r, class: look, ...more }); };
    for (const skill of Object.keys(run.films)) dot(placeOn(map, Number(skill)), 3.5, "filmed");
    for (const pin of state.pins) if (pin.run === map.run) dot(placeOn(map, pin.skill), 5.5, "pin", { fill: pin.colour });
    if (state.place?.map === map) dot(state.place.at, 5.5, "place");
    if (state.skill >= 0 && state.run === map.run) {
      const line = [state.skill, ...ancestors(run, state.skill).chain.slice(0, ANCESTORS)].map((i) => placeOn(map, i));
      line.slice(1).forEach((to, k) => { const [[x1, y1], [x2, y2]] = [on(line[k]), on(to)]; add("line", { x1, y1, x2, y2 }); });
      line.slice(1).forEach((place) => { dot(place, 3, "ancestor"); });
      dot(line[0], 7.5, "shown");
    } else if (state.skill >= 0) { // the same outcome in the other run
      const twin = twinOf(map);
      if (twin >= 0) dot(placeOn(map, twin), 7.5, "twin");
    }
    Object.assign(map.marks.style, { left: `${left}px`, top: `${top}px`, width: `${wide}px`, height: `${height}px` });
    map.marks.replaceChildren(...shapes);
  }

  function twinOf(map) {
    const from = data.runs[state.run].spaces.truth.table, to = data.runs[map.run].spaces.truth.table;
    return closest(to, rowOf(from, state.skill), 1)[0]?.skill ?? -1;
  }

  /** The k rows of a table that are nearest to values, of which NaN do not matter; from column `first` on. */
  function closest(table, values, k, first = 0) {
    const found = [], n = table.values.shape[0];
    for (let i = 0; i < n; i++) {
      let sum = 0;
      for (let j = 0; j < values.length; j++) sum += (entry(table, i, first + j) - values[j]) ** 2;
      if (!Number.isNaN(sum) && (found.length < k || sum < found[found.length - 1].sum)) {
        const at = found.findIndex((each) => sum < each.sum);
        found.splice(at < 0 ? found.length : at, 0, { skill: i, sum });
        found.length = Math.min(found.length, k);
      }
    }
    return found.map(({ skill, sum }) => ({ skill, distance: Math.sqrt(sum) }));
  }

  /** Those of which a skill is an offspring, as far as they are here, the nearest first; and why there are no more. */
  function ancestors(run, skill) {
    const chain = [];
    for (let i = skill; ;) {
      const parent = run.parent[i];
      if (parent < 0) return { chain, end: run.born[i] < 0 ? "unknown" : "random" };
      if (skillOf(run, parent) < 0 || parent >= run.id[i]) return { chain, end: parent }; // a parent is older
      i = skillOf(run, parent);
      chain.push(i);
    }
  }

  /** The skill of an id; -1 where it is not in the page. */
  function skillOf(run, id) {
    run.index ??= new Map(Array.from(run.id, (each, i) => [each, i]));
    return run.index.get(id) ?? -1;
  }

  // Time: how the run was at its updates. The last place of the slider is what it is now, and no moment.
  function rowThen(id) {
    state.moment.index ??= new Map(Array.from(state.moment.id, (each, row) => [each, row]));
    return state.moment.index.get(id);
  }

  function travel(k) {
    const [run] = data.runs, before = state.moment;
    state.moment = run.moments[k] ?? null;
    state.place = null;
    if (Boolean(before) !== Boolean(state.moment)) {
      models.sources[0].selected.indices = [];
      for (const map of maps) {
        rendererOf(map.figure, "points").visible = !state.moment;
        rendererOf(map.figure, "then").visible = Boolean(state.moment);
        map.element.querySelectorAll("select").forEach((select) => { select.disabled = Boolean(state.moment); });
        label(map);
      }
    }
    models.then.data = state.moment ? columnsThen(run, state.moment) : Object.fromEntries(Object.keys(models.then.data).map((name) => [name, []]));
    $("when").textContent = whenOf(run);
    mark();
  }

  function columnsThen(run, moment) {
    const columns = { color: coloursThen() };
    for (const { space } of maps) for (const [j, axis] of ["x", "y"].entries()) {
      const name = `${space}_${axis}`, table = moment.places[space], now = models.sources[0].data[name];
      columns[name] = Float32Array.from(moment.id, (id, row) => (table ? entry(table, row, j) : now[skillOf(run, id)] ?? NaN)); // genes do not change
    }
    return columns;
  }

  /** Colours by place; or by a number, of those that are still there. */
  function coloursThen() {
    const { id, colours } = state.moment, [run] = data.runs, now = models.sources[0].data.color;
    return shaded ? colours.map((_, row) => now[skillOf(run, id[row])] ?? 0x888888ff) : colours;
  }

  function whenOf(run) {
    if (!state.moment) return `now: ${run.total.toLocaleString("en")} skills`;
    const { generation, moment, size, l } = state.moment;
    return `generation ${generation.toLocaleString("en")}${moment ? `, ${moment} an update` : ""}: ${size.toLocaleString("en")} skills${l === null ? "" : `, l ${number(l)}`}`;
  }

  // A skill.
  const number = (value) => (Number.isInteger(value) ? value.toLocaleString("en") : Number(value).toPrecision(4));
  const nameOf = (run, i) => `skill ${data.runs[run].rows[i]}${data.runs.length > 1 ? `, ${data.runs[run].name}` : ""}`;

  function show(run, skill, place = null) {
    Object.assign(state, { run, skill, place });
    mark();
    drawSkill();
    document.dispatchEvent(new CustomEvent("shown", { detail: { run, skill } }));
  }

  function drawSkill() {
    if (state.skill < 0) return;
    showFilm();
    const run = data.runs[state.run], { skill, place } = state;
    $("which").textContent = nameOf(state.run, skill) + (place ? ", the nearest to that place" : "");
    const expected = place?.decoded ?? (place ? null : reconstruction(run, skill));
    const observed = rowOf(run.observed, skill);
    const pinned = state.pins.filter((pin) => pin.run !== state.run || pin.skill !== skill)
      .map((pin) => ({ text: nameOf(pin.run, pin.skill), of: rowOf(data.runs[pin.run].observed, pin.skill), colour: pin.colour, width: 2 }));
    const entries = [
      { text: place ? "observed, nearest skill" : "observed", of: observed, colour: ink.ink, width: 2, dots: true },
      ...(expected ? [{ text: place ? "expected at that place" : "reconstructed", of: expected, colour: ink.expected, width: 2, dash: "6 4" }] : []),
    ];
    const image = run.sight.kind === "image"; // lines are drawn over those before
    draw($("skill"), models.lines.skill, run, image ? [...entries, ...pinned] : [...pinned, ...entries]);
    legend(image ? [] : entries);
    genesOf(run, skill);
    $("facts").replaceChildren(...factsOf(run, skill).map(([name, value]) => tr(["th", name], ["td", value, "number"])));
    ancestryOf(run, skill);
    animate(Number($("step").value));
  }

  /** Observations as lines or as pictures, in whichever part of the page. */
  function draw(part, figure, run, entries) {
    const image = run.sight.kind === "image";
    part.querySelector(".lines").hidden = image;
    part.querySelector(".pictures").replaceChildren();
    if (image) {
      part.querySelector(".pictures").replaceChildren(...entries.map((each) => picture(run, each)));
      return;
    }
    const lines = { xs: [], ys: [], color: [], width: [], alpha: [], dash: [] };
    const samples = { x: [], y: [], color: [], size: [] };
    for (const { of, colour: color, width: line = 1, alpha = 1, dash = "solid", dots } of entries) {
      for (const [xs, ys] of linesOf(run, of)) {
        append(lines, [xs, ys, color, line, alpha, dash]);
        if (dots && xs.length <= 120) xs.forEach((x, k) => { append(samples, [x, ys[k], color, 4]); });
      }
    }
    fill(figure, "lines", lines);
    fill(figure, "samples", samples);
  }

  /** The lines of an observation, as they are numbers, one after the other: a path, or several over time. */
  function linesOf({ sight: { kind, shape }, stage }, values) {
    const [steps, columns] = shape, read = (j) => Array.from({ length: steps }, (_, k) => values[k * columns + j]);
    if (kind === "path") return [[[...(stage.start ? [stage.start[0]] : []), ...read(0)], [...(stage.start ? [stage.start[1]] : []), ...read(1)]]];
    const time = Array.from({ length: steps }, (_, k) => k);
    return Array.from({ length: columns }, (_, j) => [time, read(j)]);
  }

  function picture({ sight: { shape: [height, width_, channels] }, observed: { low, step } }, { of, text, colour }) {
    const figure = document.createElement("figure"), canvas = document.createElement("canvas");
    Object.assign(canvas, { width: width_, height });
    const context = canvas.getContext("2d"), image = context.createImageData(width_, height);
    const grey = (value) => 255 * (value - low[0]) / (255 * step[0] || 1);
    for (let i = 0; i < width_ * height; i++) {
      const pixel = Array.from({ length: 3 }, (_, k) => grey(of[i * channels + (channels > 1 ? k : 0)]));
      image.data.set([...pixel, 255], 4 * i);
    }
    context.putImageData(image, 0, 0);
    if (colour) canvas.style.border = `2px solid ${colour}`;
    figure.append(canvas, text ?? "");
    return figure;
  }

  function legend(entries) {
    $("skill").querySelector(".legend").replaceChildren(...entries.flatMap(({ text, colour: color, dash }) => {
      const line = document.createElement("i");
      line.style.color = color;
      line.className = dash ? "dashed" : "";
      return [line, text];
    }));
  }

  function tr(...cells) {
    const row = document.createElement("tr");
    row.append(...cells.map(([kind, text, name = ""]) => {
      const cell = document.createElement(kind);
      cell.className = name;
      cell.append(text);
      return cell;
    }));
    return row;
  }

  function genesOf(run, skill) {
    const { names, units, bounds, table } = run.spaces.genes;
    const body = document.createElement("tbody");
    body.append(...names.map((name, j) => {
      const value = entry(table, skill, j), bar = document.createElement("i");
      bar.style.setProperty("--at", (value - bounds[j][0]) / (bounds[j][1] - bounds[j][0]));
      return tr(["th", name], ["td", bar, "bar"], ["td", `${number(value)} ${units[j]}`.trim(), "number"]);
    }));
    $("genes").replaceChildren(body);
  }

  function factsOf(run, skill) {
    const truth = run.spaces.truth;
    return [
      ...(truth ? truth.names.slice(0, 6).map((name, j) => [name, number(entry(truth.table, skill, j))]) : []),
      ...Object.entries(run.values).map(([name, values]) => [name === "born" ? "born at evaluation" : name, number(values[skill])]),
    ];
  }

  function ancestryOf(run, skill) {
    const { chain, end } = ancestors(run, skill), text = $("ancestry");
    const parts = chain.slice(0, 5).flatMap((i) => [" ← ", button(`skill ${run.rows[i]}`, () => show(state.run, i))]);
    const more = chain.length > 5 ? ` ← ${chain.length - 5} more` : "";
    const last = end === "unknown" ? "" : end === "random" ? " ← made at random" : ` ← individual ${end}, which is not in this page`;
    text.replaceChildren("Parents: this", ...parts, more + last);
    text.hidden = end === "unknown";
  }

  function button(text, pressed) {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = text;
    made.addEventListener("click", pressed);
    return made;
  }

  // What moves.
  /** How many moments there are to see of a skill: frames of its film, or samples of its path. */
  function momentsOf({ sight: { kind, shape } }) {
    return state.film ? state.film.frames : kind === "path" ? shape[0] : 0;
  }

  function animate(moment) {
    const run = data.runs[state.run], { stage, sight } = run, figure = models.lines.skill, moments = momentsOf(run);
    document.querySelector("aside .player").hidden = moments === 0 || state.skill < 0;
    if (moments === 0 || state.skill < 0) return;
    if (state.film) paint(state.film, moment);
    const steps = sight.shape[0], k = Math.max(Math.ceil((moment + 1) * steps / moments) - 1, 0);
    $("now").textContent = state.film ? `${((moment + 1) / moments * state.film.seconds).toFixed(1)} of ${state.film.seconds.toFixed(1)} s` : `${k + 1} of ${steps}`;
    if (sight.kind !== "path") return;
    const at = [0, 1].map((j) => entry(run.observed, state.skill, 2 * k + j));
    const radius = stage.radius || 0.02 * (stage.high[0] - stage.low[0]);
    fill(figure, "body", { x: [at[0]], y: [at[1]], radius: [radius] });
    fill(figure, "arm", stage.arm ? armOf(run, k) : { x: [], y: [] });
  }

  function armOf({ stage: { arm }, spaces: { genes } }, k) {
    const found = { x: [0], y: [0] };
    for (let joint = 0, angle = 0; joint < arm.joints; joint++) {
      angle += arm.first[k] * entry(genes.table, state.skill, joint) + arm.final[k] * entry(genes.table, state.skill, arm.joints + joint);
      found.x.push(found.x[joint] + arm.link * Math.cos(angle));
      found.y.push(found.y[joint] + arm.link * Math.sin(angle));
    }
    return found;
  }

  function play() {
    if (state.playing || state.skill < 0) { stop(); return; }
    const run = data.runs[state.run], moments = momentsOf(run), seconds = state.film?.seconds ?? run.stage?.seconds, slider = $("step");
    if (!moments) return;
    const from = Number(slider.value) >= moments - 1 ? 0 : Number(slider.value), began = performance.now();
    const frame = (now) => {
      slider.value = Math.min(from + Math.floor((now - began) / 1000 / seconds * moments), moments - 1);
      animate(Number(slider.value));
      if (Number(slider.value) < moments - 1) state.playing = requestAnimationFrame(frame); else stop();
    };
    state.playing = requestAnimationFrame(frame);
    $("play").textContent = "❚❚";
  }

  function stop() {
    cancelAnimationFrame(state.playing);
    state.playing = null;
    $("play").textContent = "▶";
  }

  // Films of robots: of a skill one picture, with all frames below each other.
  /** Take the film of the skill that is shown, or else of the nearest skill that has one. */
  function showFilm() {
    const run = data.runs[state.run], near = run.films[state.skill] ? state.skill : nearestFilmed(run), slider = $("step");
    const [canvas, caption] = $("film").children, moments = momentsOf(run);
    state.film = run.films[near] ?? null;
    $("film").hidden = !state.film && !run.filmed;
    canvas.hidden = !state.film;
    caption.replaceChildren(...captionOf(run, near));
    if (momentsOf(run) !== moments) {
      const share = slider.value / slider.max;
      slider.max = momentsOf(run) - 1;
      slider.value = Math.round(share * slider.max);
    }
  }

  function captionOf(run, near) {
    if (near === state.skill) return [];
    const nearest_ = near < 0 ? "" : `This is ${nameOf(state.run, near)}, the nearest of those that were filmed, which have rings. `;
    if (run.filmed === "asked") return [nearest_, button("Film this skill", () => askFilm(run, state.skill))];
    return [nearest_ || "The robot can be filmed: write the page with --films 24."];
  }

  function nearestFilmed(run) {
    const { table } = run.spaces.descriptor;
    let best = -1, least = Infinity;
    for (const skill of Object.keys(run.films).map(Number)) {
      let sum = 0;
      for (let j = 0; j < width(table); j++) sum += (entry(table, skill, j) - entry(table, state.skill, j)) ** 2;
      if (sum < least) { best = skill; least = sum; }
    }
    return best;
  }

  function paint(film, frame) {
    const [canvas] = $("film").children;
    if (!film.picture) {
      film.picture = new Image();
      film.picture.src = film.image;
    }
    const { picture, frames } = film;
    if (!picture.complete) { // what is shown by then may be another one
      picture.decode().then(() => { if (state.film === film) paint(film, Number($("step").value)); });
      return;
    }
    const wide = picture.naturalWidth, high = picture.naturalHeight / frames;
    if (canvas.width !== wide || canvas.height !== high) Object.assign(canvas, { width: wide, height: high });
    canvas.getContext("2d").drawImage(picture, 0, frame * high, wide, high, 0, 0, wide, high);
  }

  async function askFilm(run, skill) {
    say(`The film of ${nameOf(state.run, skill)} is drawn: some seconds.`);
    const { trouble, ...film } = await ask(`film?id=${run.id[skill]}`).catch(() => ({ trouble: "The server does not answer." }));
    say(trouble ?? "");
    if (trouble) return;
    run.films[skill] = film;
    state.filming = true; // and those that are pinned
    mark();
    drawSkill();
    if (data.runs[state.run] === run && state.skill === skill) play();
  }

  // Pins.
  function pin(run, skill) {
    const at = state.pins.findIndex((each) => each.run === run && each.skill === skill);
    if (at >= 0) state.pins.splice(at, 1);
    else {
      const free = PINS.find((colour_) => state.pins.every((each) => each.colour !== colour_));
      if (!free) { say(`${PINS.length} skills are pinned: take one away first`); return; }
      state.pins.push({ run, skill, colour: free });
    }
    listPins();
    show(run, skill);
    if (at >= 0) return;
    if (state.filming && !data.runs[run].films[skill]) askFilm(data.runs[run], skill);
    else if (!state.playing && !matchMedia("(prefers-reduced-motion)").matches) play();
  }

  function listPins() {
    $("pins").replaceChildren(...state.pins.map((each) => {
      const made = button(`${nameOf(each.run, each.skill)} ✕`, () => pin(each.run, each.skill));
      made.style.setProperty("--pin", each.colour);
      made.addEventListener("mouseenter", () => show(each.run, each.skill));
      const item = document.createElement("li");
      item.append(made);
      return item;
    }));
  }

  // Sets.
  function choose(run) {
    const indices = [...models.sources[run].selected.indices];
    state.set = indices.length ? { run, indices } : null;
    drawSet();
  }

  const css = (color) => `#${(color >>> 8).toString(16).padStart(6, "0")}`;

  function drawSet() {
    $("together").hidden = !state.set;
    $("many").textContent = "Drag a lasso around skills to see them together";
    if (!state.set) return;
    const { run: k, indices } = state.set, run = data.runs[k], shades = models.sources[k].data.color;
    const most = run.sight.kind === "image" ? PICTURES : LINES;
    const some = indices.filter((_, n) => indices.length <= most || Math.floor(n * most / indices.length) !== Math.floor((n - 1) * most / indices.length));
    $("many").textContent = `${indices.length.toLocaleString("en")} skills selected${some.length < indices.length ? `, ${some.length} shown` : ""}`;
    draw($("set"), models.lines.set, run, some.map((i) => ({ of: rowOf(run.observed, i), colour: css(shades[i]), width: 1.2, alpha: 0.6 })));
    if (run.sight.kind !== "image") fit(models.lines.set);
    $("code").textContent = python();
  }

  function python() {
    const { run, indices } = state.set, { code, id } = data.runs[run];
    const ids = indices.map((i) => id[i]).join(", ");
    return `import numpy as np, auroraqd; skills = ${code}; rows = np.flatnonzero(np.isin(skills.id, [${ids}]))`;
  }

  /** The columns of an export: name to a function from a skill to its number. */
  function columnsOf(run) {
    const columns = new Map(Object.entries({ row: run.rows, id: run.id, parent: run.parent, born: run.born, ...run.values })
      .map(([name, values]) => [name, (i) => values[i]]));
    columns.set("born", (i) => run.born[i]); // as a whole number
    const taken = new Set([...columns.keys(), "observation"]);
    for (const [space, { names, table }] of Object.entries(run.spaces)) names.forEach((name, j) => {
      const own = free(taken, name, space);
      taken.add(own);
      columns.set(own, (i) => entry(table, i, j));
    });
    return columns;
  }

  function save(kind) {
    const run = data.runs[state.set.run], { indices } = state.set, columns = columnsOf(run), names = [...columns.keys()];
    const quoted = (text_) => `"${text_.replaceAll('"', '""')}"`, valuesOf = (i) => [...columns.values()].map((of) => of(i));
    const text = kind === "csv"
      ? [names.map(quoted), ...indices.map(valuesOf)].map((line) => `${line.join(",")}\n`).join("")
      : JSON.stringify({ run: run.name, python: python(), observation_shape: run.sight.shape,
        skills: indices.map((i) => Object.fromEntries([...names.map((name, j) => [name, valuesOf(i)[j]]), ["observation", [...rowOf(run.observed, i)]]])) });
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text], { type: kind === "csv" ? "text/csv" : "application/json" }));
    link.download = `skills.${kind}`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }

  // Seeking.
  function seek(text) {
    const values = (text.match(/[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?/gi) ?? []).map(Number);
    const run = data.runs[state.run], word = text.trim().toLowerCase();
    if (!values.length) { say("Say where: two numbers, like “ends near (0.3, 0.2)”; or “skill 17”, or “id 17”."); return; }
    if (word.startsWith("skill") || word.startsWith("id")) {
      const i = run[word.startsWith("id") ? "id" : "rows"].indexOf(values[0]);
      if (i < 0) say(`There is no ${word.startsWith("id") ? "id" : "skill"} ${values[0]} in this page.`);
      else { say(""); show(state.run, i); }
      return;
    }
    const path = run.sight.kind === "path" && !word.startsWith("truth"), truth = run.spaces.truth;
    if (!path && !truth) { say("There is no ground truth to look in: seek “skill 17” or “id 17”."); return; }
    const table = path ? run.observed : truth.table, wanted = values.slice(0, path ? 2 : width(table));
    const found = closest(table, wanted, FOUND, path ? width(table) - 2 : 0);
    if (wanted.length < 2 && path) { say("Two numbers are needed, like “ends near (0.3, 0.2)”."); return; }
    models.sources[state.run].selected.indices = found.map(({ skill }) => skill);
    show(state.run, found[0].skill);
    say(`The ${found.length} nearest are selected; the nearest, ${nameOf(state.run, found[0].skill)}, is ${number(found[0].distance)} away.`);
  }

  const say = (text) => { $("said").textContent = text; };

  // Keys.
  function walk(map, key) {
    const [right, up] = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[key];
    if (state.skill < 0 || state.run !== map.run) {
      const { x_range, y_range } = map.figure;
      return nearest(map, (x_range.start + x_range.end) / 2, (y_range.start + y_range.end) / 2).skill;
    }
    const ahead = (dx, dy) => { const forward = dx * right + dy * up; return forward > 0.5 && forward >= Math.abs(dx * up + dy * right); };
    return nearest(map, ...placeOn(map, state.skill), ahead).skill;
  }

  function key(event) {
    const typing = /INPUT|SELECT|TEXTAREA/.test(event.target.tagName), map = maps.find(({ element }) => element.contains(event.target));
    if (event.key === "/" && !typing) $("wanted").focus();
    else if (event.key === "Escape") models.sources.forEach((source) => { source.selected.indices = []; });
    else if (typing || !map) return;
    else if (event.key.startsWith("Arrow")) { const skill = walk(map, event.key); if (skill >= 0) show(map.run, skill); }
    else if (event.key === "Enter" && state.skill >= 0) pin(state.run, state.skill);
    else if (event.key === " ") play();
    else return;
    event.preventDefault();
  }

  // Live: a page that is served asks which checkpoint there is, and is loaded anew to show another one.
  const ask = async (what) => {
    const answer = await fetch(`${what}${what.includes("?") ? "&" : "?"}${location.search.slice(1)}`);
    if (!answer.ok) throw new Error(answer.statusText);
    return answer.json();
  };

  async function follow() {
    const bar = $("live"), [said, now] = bar.children, each = bar.querySelector("input").checked;
    try {
      const { checkpoint, of, trouble } = await ask("state"), newer = checkpoint !== bar.dataset.checkpoint;
      said.textContent = trouble ? `The last good checkpoint is shown: ${trouble}`
        : newer ? `There is a new checkpoint: ${of}.` : "This is the last checkpoint.";
      now.hidden = !newer || trouble !== "";
      if (each && !now.hidden && performance.now() > REST * document.documentElement.dataset.ready) location.reload();
    } catch {
      said.textContent = "The server does not answer. This is what it showed last.";
      now.hidden = true;
    }
    setTimeout(follow, EVERY);
  }

  const chosen = (select) => select.selectedOptions[0]?.text;

  function selectText(select, text) {
    const k = [...select.options].findIndex((option) => option.text === text);
    if (k < 0 || k === select.selectedIndex) return;
    select.selectedIndex = k;
    select.dispatchEvent(new Event("change"));
  }

  const selectsOf = (map) => [...map.element.querySelectorAll("select")];

  /** Skills are kept by their ids: another checkpoint has them elsewhere. */
  function keep() {
    const [{ id }] = data.runs;
    sessionStorage.setItem(KEPT, JSON.stringify({
      pins: state.pins.map(({ skill, colour: color }) => ({ id: id[skill], colour: color })),
      shown: id[state.skill],
      set: state.set?.indices.map((i) => id[i]) ?? [],
      choices: [$("colour"), $("stream"), ...maps.flatMap(selectsOf)].map(chosen),
      each: $("live").querySelector("input").checked,
      dark: document.documentElement.dataset.theme === "dark",
    }));
  }

  function recall() {
    const kept = JSON.parse(sessionStorage.getItem(KEPT)), [run] = data.runs;
    if (!kept) return;
    theme(kept.dark);
    $("live").querySelector("input").checked = kept.each;
    [$("colour"), $("stream"), ...maps.flatMap(selectsOf)].forEach((select, k) => { selectText(select, kept.choices[k]); });
    state.pins = kept.pins.map(({ id, colour: color }) => ({ run: 0, skill: skillOf(run, id), colour: color })).filter(({ skill }) => skill >= 0);
    listPins();
    models.sources[0].selected.indices = kept.set.map((id) => skillOf(run, id)).filter((skill) => skill >= 0);
    const shown = skillOf(run, kept.shown);
    show(0, shown < 0 ? run.first : shown);
    const gone = kept.pins.length - state.pins.length;
    if (gone) say(`${gone} of the skills that were pinned ${gone > 1 ? "are" : "is"} not stored any more.`);
  }

  function live() {
    recall();
    $("live").querySelector("button").addEventListener("click", () => location.reload());
    addEventListener("pagehide", keep);
    follow();
  }

  // Looks.
  function dress() {
    const style = getComputedStyle(document.documentElement);
    ink = Object.fromEntries(["ink", "soft", "line", "paper", "expected"].map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
    const figures = [...maps.map(({ figure }) => figure), ...Object.values(models.lines)];
    for (const figure of figures) {
      Bokeh.index.find_one(figure).request_paint(); // axes and grids have the colours of page.css
      for (const [name, properties] of [["arm", { line_color: ink.soft }], ["border", { line_color: ink.soft }], ["body", { fill_color: ink.expected, line_color: ink.ink }]]) {
        rendererOf(figure, name)?.glyph.setv(properties);
      }
    }
    mark();
    drawSkill();
  }

  /** Make a figure of paths show all of its stage; with equal units, unless that is far wider than high. */
  function fit(figure) {
    const { stage } = data.runs[0], { inner_width, inner_height } = figure;
    if (!stage || !(inner_width > 0)) return;
    const [low, high] = [union("low", Math.min), union("high", Math.max)];
    const size = [0, 1].map((k) => (high[k] - low[k] || 1) * 1.04), pixels = [inner_width, inner_height];
    if (stage.equal) { const unit = Math.max(size[0] / pixels[0], size[1] / pixels[1]); size.forEach((_, k) => { size[k] = unit * pixels[k]; }); }
    [figure.x_range, figure.y_range].forEach((range, k) => {
      const middle = (low[k] + high[k]) / 2;
      range.setv({ start: middle - size[k] / 2, end: middle + size[k] / 2 });
    });
  }

  /** What does not move: walls, or the ground. */
  function border(figure) {
    const { stage } = data.runs[0], [left, bottom] = stage?.low ?? [], [right, top] = stage?.high ?? [];
    const ground = stage?.ground ? { x: [left, right], y: [0, 0] } : { x: [], y: [] };
    fill(figure, "border", stage?.walls ? { x: [left, right, right, left, left], y: [bottom, bottom, top, top, bottom] } : ground);
    [[figure.below[0], 0], [figure.left[0], 1]].forEach(([axis, k]) => { axis.axis_label = stage?.labels[k] ?? ""; });
  }

  const union = (end, of) => [0, 1].map((k) => of(...data.runs.map(({ stage }) => stage[end][k])));

  function options(select, names, chosen, changed) {
    select.replaceChildren(...names.map((name, value) => new Option(name, value, false, value === chosen)));
    select.addEventListener("change", () => changed(Number(select.value)));
  }

  function describe() {
    const [run] = data.runs, several = data.runs.length > 1;
    $("title").textContent = several ? `${data.runs.length} runs` : run.name;
    $("lead").textContent = `${run.about} Each point is a skill, which was found by trying. Skills that look alike to the robot are near each other in descriptor space. Point at one, or tap it, to see what it does.`.trim();
    const shown = (each) => (each.rows.length < each.total
      ? `${each.rows.length.toLocaleString("en")} of ${each.total.toLocaleString("en")} skills, drawn at random: the rest would make the page too large`
      : `${each.total.toLocaleString("en")} skills`);
    $("about").textContent = several
      ? data.runs.map((each) => `${each.name}: ${shown(each)}`).join(" · ")
      : [shown(run), ...run.facts.map(([name, value]) => `${name} ${value}`)].join(" · ");
  }

  /** The streams of what was observed that all runs have, or just the first of each. */
  function streamNames() {
    const names = Object.keys(data.runs[0].streams).filter((name) => data.runs.every((run) => name in run.streams));
    return names.length ? names : [null];
  }

  /** Show a stream of what was observed: how, and on which stage. */
  function take(name) {
    stop();
    for (const run of data.runs) Object.assign(run, run.streams[name] ?? Object.values(run.streams)[0]);
    state.place = null;
    const [{ sight, stage, spaces: { truth } }] = data.runs, last = sight.shape[0] - 1;
    $("set").classList.toggle("equal", Boolean(stage?.equal));
    $("step").max = last;
    $("step").value = last;
    $("wanted").placeholder = sight.kind === "path" ? "ends near (x, y); skill 17" : truth ? "truth near (a, b); skill 17" : "skill 17; id 17";
    Object.values(models.lines).forEach((figure) => { border(figure); fit(figure); });
  }

  function offerStreams() {
    const names = streamNames(), select = $("stream"), { left_out: leftOut } = data.runs[0];
    $("streams").hidden = names.length + leftOut.length < 2;
    options(select, names.map((name) => name ?? ""), 0, (k) => { take(names[k]); mark(); drawSet(); drawSkill(); });
    for (const name of leftOut) {
      const option = new Option(`${name}: too large beside so many skills`);
      option.disabled = true;
      select.append(option);
    }
    take(names[0]);
  }

  function listen() {
    const choices = colourings(), names = [...choices.keys()];
    options($("colour"), names, 0, (k) => colour(choices.get(names[k])));
    for (const map of maps) {
      const space = data.runs[map.run].spaces[map.space], titles = columnNames(space), [title, ...selects] = map.element.querySelector("figcaption").children;
      title.textContent = data.runs.length > 1 ? data.runs[map.run].name : space.title;
      selects.forEach((select, k) => {
        select.hidden = titles.length < 3;
        options(select, titles, map.shown[k], (j) => { map.shown[k] = j; setAxes(map); });
      });
    }
    models.sources.forEach((source, run) => { source.selected.properties.indices.change.connect(() => choose(run)); });
    Object.values(models.lines).forEach((figure) => {
      for (const side of ["inner_width", "inner_height"]) figure.properties[side].change.connect(() => fit(figure));
    });
    $("search").addEventListener("submit", (event) => { event.preventDefault(); seek($("wanted").value); });
    $("csv").addEventListener("click", () => save("csv"));
    $("json").addEventListener("click", () => save("json"));
    $("copy").addEventListener("click", () => navigator.clipboard?.writeText(python()).then(() => say("Copied."), () => say(python())));
    $("clear").addEventListener("click", () => { models.sources.forEach((source) => { source.selected.indices = []; }); });
    $("moment").addEventListener("input", () => travel(Number($("moment").value)));
    $("play").addEventListener("click", play);
    $("step").addEventListener("input", () => { stop(); animate(Number($("step").value)); });
    $("theme").addEventListener("click", () => theme(document.documentElement.dataset.theme !== "dark"));
    document.addEventListener("keydown", key);
  }

  function theme(dark) {
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    if (models) dress();
  }

  function start(givenModels, givenData) {
    [models, data] = [givenModels, unpacked(givenData)];
    const elements = document.querySelectorAll(".map");
    maps = models.maps.map((map, k) => ({
      ...map, element: elements[k], shown: [...data.runs[map.run].spaces[map.space].shown],
      marks: elements[k].querySelector(".marks"), view: Bokeh.index.find_one(map.figure),
    }));
    describe();
    offerStreams();
    const { moments } = data.runs[0], aged = data.runs.length === 1 && moments.length > 0;
    for (const id of ["time", "aged"]) $(id).hidden = !aged;
    Object.assign($("moment"), { max: moments.length, value: moments.length });
    $("when").textContent = whenOf(data.runs[0]);
    dress();
    maps.forEach(label);
    listen();
    if (matchMedia("(pointer: coarse)").matches) maps.forEach(({ figure }) => { figure.toolbar.active_drag = null; }); // or one could not scroll
    drawSet();
    maps.forEach((map) => { map.view.repainted.connect(() => markOn(map)); });
    show(0, data.runs[0].first);
    if ($("live")) live();
    for (const { figure } of maps) rendererOf(figure, "points").visible = true;
    requestAnimationFrame(() => setTimeout(() => { document.documentElement.dataset.ready = Math.round(performance.now()); })); // drawn
  }

  const named = (name) => maps.find(({ figure }) => figure.name === name);

  function move(name, { x, y }) {
    if (!maps) return;
    const map = named(name), { skill } = nearest(map, x, y);
    if (skill >= 0 && (skill !== state.skill || map.run !== state.run || state.place)) show(map.run, skill);
  }

  function tap(name, { x, y }) {
    const map = named(name), { skill, distance } = nearest(map, x, y);
    if (skill < 0) return;
    if (distance <= NEAR) { pin(map.run, skill); return; }
    if (state.moment) return; // the descriptor of then is not here
    show(map.run, skill, { map, at: [x, y], decoded: imagined(map, skill, x, y) });
  }

  /** What is expected at a place of a map of descriptors; where these have more dimensions, on from the nearest skill. */
  function imagined(map, skill, x, y) {
    const run = data.runs[map.run], { names, table, directions } = run.spaces.descriptor;
    if (map.space !== "descriptor" || !run.decoder) return null;
    const from = placeOn(map, skill), place = rowOf(table, skill);
    [x, y].slice(0, names.length).forEach((value, axis) => {
      const j = map.shown[axis];
      if (j < names.length) place[j] += value - from[axis];
      else directions[j - names.length].forEach((share, k) => { place[k] += share * (value - from[axis]); });
    });
    return decoded(run, place);
  }

  /** Without a GPU, WebGL takes longer than the plain canvas, which Bokeh draws on where there is no WebGL. */
  function preferPlainCanvas() {
    const gl = document.createElement("canvas").getContext("webgl"), info = gl?.getExtension("WEBGL_debug_renderer_info");
    if (gl && !/swiftshader|llvmpipe|software|basic render/i.test(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER))) return;
    const { getContext } = HTMLCanvasElement.prototype;
    HTMLCanvasElement.prototype.getContext = function context(kind, ...options) {
      return kind === "webgl" ? null : getContext.call(this, kind, ...options);
    };
  }

  preferPlainCanvas();
  theme(matchMedia("(prefers-color-scheme: dark)").matches);
  return { start, move, tap, show, state, data: () => data };
})();
