// What the page does beyond standing still: the picture in space, and the choice of what is shown.
"use strict";
(() => {
  const TENTHS = 10; // vectors come in tenths of a micrometre
  const MICROMETRES_A_MM = 1000;
  const VIEWS = { corner: [-0.9, 0.45], top: [-Math.PI / 2, Math.PI / 2], front: [0, 0], side: [-Math.PI / 2, 0] };
  const CLASSES = [0.25, 0.5, 1]; // shares of the first step's 95 % where arrows grow thicker
  // Of the scene, the first step's 95 %: more where a later step is what is looked at.
  const ARROW_SHARE = 0.08, ARROW_SHARE_OF_FIRST = 0.2;
  // Of the scene: what would be longer (a gross error) is cut and ends in two bars.
  const LONGEST_ARROW = 0.4;
  // More arrows than this are drawn thinner and shorter, so that they do not cover one another.
  const UNCROWDED = 250;
  const PICK_PIXELS = 16;
  const TURN = 0.09, ZOOM = 1.15;
  const NEIGHBOURS = 3;

  class Scene {
    constructor(data) {
      Object.assign(this, data);
      const everything = this.points.concat(this.arm);
      const { low, high } = boundsOf(everything);
      this.low = low;
      this.centre = low.map((value, k) => (value + high[k]) / 2);
      this.size = Math.hypot(...high.map((value, k) => value - low[k]));
      this.lengths = this.vectors.map((vectors) => {
        const lengths = [];
        for (let i = 0; i < vectors.length; i += 3) lengths.push(Math.hypot(vectors[i], vectors[i + 1], vectors[i + 2]) / TENTHS);
        return lengths;
      });
      this.usual = quantile(this.lengths[0], 0.95) || 1;
      this.limits = CLASSES.map((share) => share * roundNumber(this.usual));
      this.slender = Math.min(1, Math.sqrt(UNCROWDED / this.rows.length));
      // Millimetres drawn for every micrometre of error.
      this.gain = roundNumber((this.slender * (this.vectors.length > 1 ? ARROW_SHARE_OF_FIRST : ARROW_SHARE) * this.size) / this.usual);
      // Where arrows end, of all steps: there has to be room for them too.
      this.ends = this.vectors.flatMap((vectors, step) => vectors.map((value, i) =>
        this.points[i] + (this.drawnShare(step, Math.floor(i / 3)) * this.gain * value) / TENTHS));
    }

    /** How much of an arrow is drawn: all, or as much as there is room for. */
    drawnShare(step, index) {
      return Math.min(1, (LONGEST_ARROW * this.size) / (this.gain * this.lengths[step][index]));
    }

    classOf(length) {
      return this.limits.filter((limit) => length >= limit).length;
    }
  }

  // Entries of the legend: as many side by side as fit, above the picture.
  const ENTRY_WIDTH = 165, ENTRY_HEIGHT = 17, LEGEND_TOP = 12, RULER_HEIGHT = 34;
  const legendColumns = (width) => Math.max(1, Math.min(CLASSES.length + 1, Math.floor((width - 16) / ENTRY_WIDTH)));
  const legendHeight = (width) => LEGEND_TOP + ENTRY_HEIGHT * Math.ceil((CLASSES.length + 1) / legendColumns(width)) + 4;

  /** The view under which points, arrows and arm fill a stage of so many pixels below `top`, seen under two angles [rad]. */
  function fitted(scene, angles, width, height, top = 0) {
    const flat = { axes: viewAxes(...angles), centre: scene.centre, scale: 1, left: 0, top: 0 };
    const places = [];
    for (const points of [scene.points, scene.arm, scene.ends]) {
      for (let i = 0; i < points.length; i += 3) places.push(...project(flat, points[i], points[i + 1], points[i + 2]), 0);
    }
    const { low, high } = boundsOf(places);
    const room = height - top - (top ? RULER_HEIGHT : 0);
    const scale = Math.min((0.86 * width) / (high[0] - low[0]), ((top ? 0.94 : 0.8) * room) / (high[1] - low[1]));
    return { scale, left: width / 2 - (scale * (low[0] + high[0])) / 2, top: top + room / 2 - (scale * (low[1] + high[1])) / 2 };
  }

  /** One drawing of a scene under a view {angles, scale, left, top}: SVG text, and the places of arrow tips for picking. */
  function draw(scene, step, look, width, height, full, rings = []) {
    const view = { ...look, axes: viewAxes(...look.angles), centre: scene.centre };
    const at = (x, y, z) => project(view, x, y, z);
    const word = ([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`;
    const parts = [];
    parts.push(`<path class="floor-grid" d="${floorGrid(scene, at, word)}"/>`);
    let arm = "", joints = "";
    for (let i = 0; i < scene.arm.length; i += 3) {
      const place = word(at(scene.arm[i], scene.arm[i + 1], scene.arm[i + 2]));
      arm += (i ? "L" : "M") + place;
      joints += `M${place}h0`;
    }
    parts.push(`<path class="arm" d="${arm}"/><path class="joint" d="${joints}"/>`);

    const vectors = scene.vectors[step], paths = ["", "", "", ""], tips = [];
    const reach = scene.gain / TENTHS;
    let starts = "";
    for (let i = 0; i < scene.points.length; i += 3) {
      const x = scene.points[i], y = scene.points[i + 1], z = scene.points[i + 2];
      const from = at(x, y, z);
      const length = scene.lengths[step][i / 3];
      const cut = scene.drawnShare(step, i / 3);
      const to = at(x + cut * reach * vectors[i], y + cut * reach * vectors[i + 1], z + cut * reach * vectors[i + 2]);
      const which = scene.classOf(length);
      paths[which] += `M${word(from)}L${word(to)}${cut < 1 ? bars(from, to) : head(from, to, scene.slender * (3 + 1.5 * which))}`;
      starts += `M${word(from)}h0`;
      tips.push(to);
    }
    parts.push(`<path class="start" d="${starts}"/>`);
    paths.forEach((path, k) => parts.push(`<path class="length${k}" d="${path}"/>`));
    parts.push(axes(view, height, full));
    if (full) parts.push(legend(scene, view, width, height));
    const ringed = [...rings].map((k) => `M${word(tips[k])}h0`).join("");
    if (ringed) parts.push(`<path class="ringed" d="${ringed}"/>`);
    return { svg: `<svg class="scene" viewBox="0 0 ${width} ${height}" aria-hidden="true" style="--slender:${scene.slender.toFixed(2)}">${parts.join("")}</svg>`, tips };
  }

  function head(from, to, size) {
    const dx = to[0] - from[0], dy = to[1] - from[1], length = Math.hypot(dx, dy);
    if (length < 1.2 * size) return "";
    const ux = (dx / length) * size, uy = (dy / length) * size;
    const barb = (side) => `${(to[0] - ux + side * 0.5 * uy).toFixed(1)} ${(to[1] - uy - side * 0.5 * ux).toFixed(1)}`;
    return `M${barb(1)}L${to[0].toFixed(1)} ${to[1].toFixed(1)}L${barb(-1)}`;
  }

  /** Two short strokes across the end of an arrow that goes on. */
  function bars(from, to) {
    const dx = to[0] - from[0], dy = to[1] - from[1], length = Math.hypot(dx, dy) || 1;
    const ux = dx / length, uy = dy / length;
    const across = (back) => {
      const x = to[0] - back * ux, y = to[1] - back * uy;
      return `M${(x - 5 * uy).toFixed(1)} ${(y + 5 * ux).toFixed(1)}L${(x + 5 * uy).toFixed(1)} ${(y - 5 * ux).toFixed(1)}`;
    };
    return across(0) + across(5);
  }

  function floorGrid(scene, at, word) {
    const step = roundNumber(scene.size / 6), reach = 3;
    const middle = scene.centre.map((value) => Math.round(value / step) * step);
    const floor = Math.min(scene.low[2], scene.arm[2]);
    let path = "";
    for (let k = -reach; k <= reach; k++) {
      const end = reach * step;
      path += `M${word(at(middle[0] + k * step, middle[1] - end, floor))}L${word(at(middle[0] + k * step, middle[1] + end, floor))}`;
      path += `M${word(at(middle[0] - end, middle[1] + k * step, floor))}L${word(at(middle[0] + end, middle[1] + k * step, floor))}`;
    }
    return path;
  }

  function axes(view, height, full) {
    const length = full ? 34 : 22, left = 16 + length, top = height - 16 - length;
    return ["x", "y", "z"].map((name, k) => {
      const dx = length * view.axes[0][k], dy = -length * view.axes[1][k];
      if (Math.hypot(dx, dy) < 4) return "";
      const words = `<text x="${(left + 1.25 * dx).toFixed(1)}" y="${(top + 1.25 * dy + 4).toFixed(1)}" text-anchor="middle">${name}</text>`;
      return `<path class="axes" d="M${left} ${top}l${dx.toFixed(1)} ${dy.toFixed(1)}"/>${words}`;
    }).join("");
  }

  function legend(scene, view, width, height) {
    const pixelsAMicrometre = scene.gain * view.scale;
    const ruler = roundNumber(Math.min(130, 0.3 * width) / pixelsAMicrometre);
    const right = width - 16, y = height - 16;
    const parts = [`<path class="cover" d="M0 0H${width}V${legendHeight(width)}H0z"/>`];
    parts.push(`<path class="ruler" d="M${right} ${y}h${(-ruler * pixelsAMicrometre).toFixed(1)}m0 -4v8M${right} ${y - 4}v8"/>`);
    parts.push(`<text x="${right}" y="${y - 9}" text-anchor="end">${scene.what} of ${ruler} µm, × ${(scene.gain * MICROMETRES_A_MM).toLocaleString("en").replace(/,/g, " ")}</text>`);
    const inMillimetres = scene.limits[0] >= MICROMETRES_A_MM;
    const amount = (limit) => (inMillimetres ? `${limit / MICROMETRES_A_MM} mm` : `${limit} µm`);
    const names = [`below ${amount(scene.limits[0])}`, ...scene.limits.map((limit) => `${amount(limit)} and more`)];
    const columns = legendColumns(width), lines = Math.ceil(names.length / columns);
    names.forEach((name, k) => {
      const x = 16 + ENTRY_WIDTH * Math.floor(k / lines), middle = LEGEND_TOP + 6 + ENTRY_HEIGHT * (k % lines);
      parts.push(`<path class="length${k}" style="--slender:1" d="M${x} ${middle}h26"/><text class="entry" x="${x + 34}" y="${middle + 4}">${name}</text>`);
    });
    return parts.join("");
  }

  function start(viewer) {
    const scene = new Scene(JSON.parse(viewer.querySelector("script").textContent));
    const stage = viewer.querySelector(".stage"), readout = viewer.querySelector(".readout"), stills = viewer.querySelector(".stills");
    const usualGain = scene.gain;
    let step = scene.vectors.length - 1, angles = VIEWS.corner, zoom = 1, pan = [0, 0], picked = -1, fixed = false, tips = [], waiting = false;
    let ringed = new Set(), brush = null; // poses that are selected, and the corners of the frame that selects them
    let home = VIEWS.corner; // the angles that the picture is fitted for: turning does not change the scale

    const figure = (value) => value.toFixed(value < 10 ? 1 : 0);
    const signed = (value) => (value < 0 ? "−" : "+") + Math.abs(value).toFixed(0);

    function describe(index) {
      const v = [0, 1, 2].map((k) => scene.vectors[step][3 * index + k] / TENTHS);
      const n = scene.joint_units.length;
      const joints = scene.joint_units.map((unit, k) => `${scene.joints[n * index + k]}${unit}`.replace("-", "−")).join(" ");
      return `Row ${scene.rows[index]}: ${scene.what === "error" ? "" : `${scene.what} `}${figure(scene.lengths[step][index])} µm (x ${signed(v[0])}, y ${signed(v[1])}, z ${signed(v[2])}), joints ${joints}. ${neighbours(index)}`;
    }

    /** The poses whose joints are nearest, each as a share of its range, with their errors. */
    function neighbours(index) {
      const n = scene.joint_units.length;
      const ranges = scene.joint_units.map((_, k) => {
        const values = scene.rows.map((_row, i) => scene.joints[n * i + k]);
        return values.reduce((a, b) => Math.max(a, b)) - values.reduce((a, b) => Math.min(a, b)) || 1;
      });
      const far = scene.rows.map((_, i) => ranges.reduce((sum, range, k) => sum + ((scene.joints[n * i + k] - scene.joints[n * index + k]) / range) ** 2, 0));
      const nearest = scene.rows.map((_, i) => i).filter((i) => i !== index).sort((a, b) => far[a] - far[b]).slice(0, NEIGHBOURS);
      return `Nearest poses: ${nearest.map((i) => `row ${scene.rows[i]} (${figure(scene.lengths[step][i])} µm)`).join(", ")}.`;
    }

    function select(indices) {
      ringed = new Set(indices);
      read(-1);
      redraw();
    }

    /** Reads one pose, -1 for none; `hold`: until another one is clicked, whatever the pointer passes on its way. */
    function read(index, hold = false) {
      picked = index;
      fixed = hold && index >= 0;
    }

    /** What is read, in words and as rows of the file: the page marks no other ones as wrong. */
    function sayWhatIsRead() {
      const indices = picked >= 0 ? [picked] : [...ringed];
      const mean = indices.reduce((sum, k) => sum + scene.lengths[step][k], 0) / (indices.length || 1);
      if (picked >= 0) readout.textContent = describe(picked);
      else if (indices.length) readout.textContent = `${indices.length} poses are selected; their mean ${scene.what} is ${figure(mean)} µm.`;
      else readout.textContent = "Point at an arrow, or press N for the next worst pose, to read it.";
      stage.dispatchEvent(new CustomEvent("armtrue-read", { bubbles: true, detail: indices.map((k) => scene.rows[k]) }));
    }

    function render() {
      waiting = false;
      const width = Math.max(280, Math.round(stage.clientWidth)), height = Math.round(Math.min(620, Math.max(340, 0.58 * width)));
      const fit = fitted(scene, home, width, height, legendHeight(width));
      const look = {
        angles, scale: fit.scale * zoom,
        left: width / 2 + zoom * (fit.left - width / 2) + pan[0], top: height / 2 + zoom * (fit.top - height / 2) + pan[1],
      };
      const drawn = draw(scene, step, look, width, height, true, ringed);
      tips = drawn.tips;
      stage.innerHTML = drawn.svg;
      if (picked >= 0) {
        const [x, y] = tips[picked];
        stage.firstChild.insertAdjacentHTML("beforeend", `<circle class="picked" fill="none" cx="${x.toFixed(1)}" cy="${y.toFixed(1)}" r="9"/>`);
      }
      if (brush) {
        const [[x0, y0], [x1, y1]] = brush;
        stage.firstChild.insertAdjacentHTML("beforeend",
          `<rect class="brush-frame" x="${Math.min(x0, x1)}" y="${Math.min(y0, y1)}" width="${Math.abs(x1 - x0)}" height="${Math.abs(y1 - y0)}"/>`);
      }
      sayWhatIsRead();
    }

    function redraw() {
      if (waiting) return;
      waiting = true;
      requestAnimationFrame(render);
    }

    function drawStills() {
      stills.innerHTML = ["top", "front", "side"]
        .map((name) => {
          const look = { angles: VIEWS[name], ...fitted(scene, VIEWS[name], 300, 260) };
          return `<div>${draw(scene, step, look, 300, 260, false).svg}</div>`;
        }).join("");
    }

    function turn(right, up) {
      angles = [angles[0] - right, Math.max(-Math.PI / 2, Math.min(Math.PI / 2, angles[1] + up))];
    }

    function nextWorst() {
      const order = scene.rows.map((_, k) => k).sort((a, b) => scene.lengths[step][b] - scene.lengths[step][a]);
      read(order[(order.indexOf(picked) + 1) % order.length], true);
    }

    function see(name) {
      angles = home = VIEWS[name];
      zoom = 1;
      pan = [0, 0];
    }

    const actions = {
      corner: () => see("corner"), top: () => see("top"), front: () => see("front"), side: () => see("side"),
      longer: () => { scene.gain = roundNumber(scene.gain, 1); }, shorter: () => { scene.gain = roundNumber(scene.gain, -1); },
      worst: nextWorst,
      again: () => {
        see("corner");
        scene.gain = usualGain;
        select([]);
      },
    };
    const keys = {
      ArrowLeft: () => turn(-TURN, 0), ArrowRight: () => turn(TURN, 0), ArrowUp: () => turn(0, TURN), ArrowDown: () => turn(0, -TURN),
      "+": () => { zoom *= ZOOM; }, "=": () => { zoom *= ZOOM; }, "-": () => { zoom /= ZOOM; }, 0: actions.again,
      1: actions.top, 2: actions.front, 3: actions.side, 4: actions.corner, "]": actions.longer, "[": actions.shorter,
      n: actions.worst, N: actions.worst,
    };
    stage.addEventListener("keydown", (event) => {
      if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
      keys[event.key]();
      event.preventDefault();
      redraw();
    });
    // The buttons beside this picture: a page may have several.
    viewer.parentElement.querySelectorAll("[data-do]").forEach((button) => button.addEventListener("click", () => {
      actions[button.dataset.do]();
      redraw();
    }));
    viewer.parentElement.querySelectorAll("input[name=vectors-step]").forEach((input) => input.addEventListener("change", () => {
      step = Number(input.value);
      redraw();
      drawStills();
    }));

    // One pointer turns (with Shift moves), two pinch.
    const held = new Map();
    let moved = false;
    const span = () => {
      const [a, b] = [...held.values()];
      return Math.hypot(a[0] - b[0], a[1] - b[1]);
    };
    stage.addEventListener("pointerdown", (event) => {
      stage.setPointerCapture(event.pointerId);
      if (event.ctrlKey || event.metaKey) {
        brush = [placeOf(event), placeOf(event)];
        return;
      }
      held.set(event.pointerId, [event.clientX, event.clientY]);
      moved = false;
    });
    stage.addEventListener("pointercancel", (event) => {
      held.delete(event.pointerId);
      brush = null;
    });
    stage.addEventListener("pointerup", (event) => {
      if (brush) return void endBrush();
      held.delete(event.pointerId);
      if (!moved) pick(event, true); // a tap
    });
    stage.addEventListener("pointermove", (event) => {
      if (brush) {
        brush[1] = placeOf(event);
        redraw();
        return;
      }
      const before = held.get(event.pointerId);
      if (!before) {
        if (!fixed) pick(event);
        return;
      }
      const dx = event.clientX - before[0], dy = event.clientY - before[1];
      moved = moved || Math.hypot(dx, dy) > 2;
      const wide = held.size === 2 ? span() : 0;
      held.set(event.pointerId, [event.clientX, event.clientY]);
      if (held.size === 2) {
        zoom *= span() / (wide || 1);
        pan = [pan[0] + dx / 2, pan[1] + dy / 2];
      } else if (event.shiftKey) {
        pan = [pan[0] + dx, pan[1] + dy];
      } else {
        turn(0.008 * dx, 0.008 * dy);
      }
      redraw();
    });
    stage.addEventListener("wheel", (event) => {
      event.preventDefault();
      zoom *= Math.exp(-0.0015 * event.deltaY);
      redraw();
    }, { passive: false });

    function placeOf(event) {
      const box = stage.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    }

    /** Selects the arrows that end inside the frame, and tells the page. */
    function endBrush() {
      const [[x0, y0], [x1, y1]] = brush;
      brush = null;
      const between = (value, a, b) => value >= Math.min(a, b) && value <= Math.max(a, b);
      select(tips.flatMap(([x, y], k) => (between(x, x0, x1) && between(y, y0, y1) ? [k] : [])));
      stage.dispatchEvent(new CustomEvent("armtrue-brushed", { bubbles: true, detail: [...ringed].map((k) => scene.rows[k]) }));
    }

    // Another chart of the page selects poses by their rows.
    viewer.addEventListener("armtrue-select", (event) => {
      const rows = new Set(event.detail);
      select(scene.rows.flatMap((row, k) => (rows.has(row) ? [k] : [])));
    });

    function pick(event, hold = false) {
      const [x, y] = placeOf(event);
      let nearest = -1, least = PICK_PIXELS;
      tips.forEach((tip, k) => {
        const distance = Math.hypot(tip[0] - x, tip[1] - y);
        if (distance < least) [nearest, least] = [k, distance];
      });
      if (nearest === picked && hold === fixed) return;
      read(nearest, hold);
      redraw();
    }

    new ResizeObserver(redraw).observe(stage);
    render();
    drawStills();
  }

  function chooseView() {
    const views = document.querySelectorAll(".view");
    document.querySelectorAll("input[name=state-view]").forEach((input) => input.addEventListener("change", () => {
      views.forEach((view) => { view.hidden = view.dataset.view !== input.value; });
    }));
  }

  // On paper nothing is folded away.
  const opened = [];
  addEventListener("beforeprint", () => document.querySelectorAll("details:not([open], .screen)").forEach((details) => {
    details.open = true;
    opened.push(details);
  }));
  addEventListener("afterprint", () => opened.splice(0).forEach((details) => { details.open = false; }));

  document.documentElement.classList.add("script");
  document.querySelectorAll(".viewer").forEach(start);
  chooseView();
  // A page that puts in sections later starts them itself.
  globalThis.armtrueReport = { start, chooseView };
})();
