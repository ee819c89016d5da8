// Charts that answer: values under the pointer, poses brushed on one chart and found on the arm, peaks that are pressed.
"use strict";
globalThis.armtrueLooking = (() => {
  const NEAR_PIXELS = 14, LEAST_BRUSH = 4;
  let chart = null; // the chart of the residual against one variable: its data, its place and what is selected

  const share = ({ ends: [low, high], logarithmic }, value) =>
    (logarithmic ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low));
  const value = ({ ends: [low, high], logarithmic }, at) => (logarithmic ? low * (high / low) ** at : low + at * (high - low));
  const short = (number) => Number(number.toPrecision(4)).toLocaleString("en", { maximumSignificantDigits: 4, useGrouping: false }).replace("-", "−");

  /** Where the pointer is on a chart, as shares of its axes; null outside. */
  function at(svg, event) {
    const plot = JSON.parse(svg.dataset.plot);
    const box = svg.getBoundingClientRect(), scale = svg.viewBox.baseVal.width / box.width;
    const [left, top, width, height] = plot.box;
    const x = ((event.clientX - box.left) * scale - left) / width, y = 1 - ((event.clientY - box.top) * scale - top) / height;
    return { plot, x, y, inside: x >= 0 && x <= 1 && y >= 0 && y <= 1, pixel: scale };
  }

  function place(plot, x, y) {
    const [left, top, width, height] = plot.box;
    return [left + width * share(plot.x, x), top + height * (1 - share(plot.y, y))];
  }

  /** What every chart says under the pointer: the values of both axes. */
  function readValues(event) {
    const svg = event.target.closest && event.target.closest("svg.panel[data-plot]");
    if (!svg || svg.closest(".look-figure")) return;
    const here = at(svg, event);
    const words = here.inside
      ? `${here.plot.x.name}: ${short(value(here.plot.x, here.x))} · ${here.plot.y.name}: ${short(value(here.plot.y, here.y))}` : "";
    let readout = svg.parentElement.querySelector(":scope > .values");
    if (!readout) {
      readout = document.createElement("p");
      readout.className = "values readout";
      svg.after(readout);
    }
    readout.textContent = words;
  }

  /** A peak of a spectrum: as if its button below were pressed. */
  function pressPeak(event) {
    const svg = event.target.closest && event.target.closest("svg.panel[data-plot]");
    const figure = svg && svg.closest("figure");
    const buttons = figure ? [...figure.querySelectorAll("button[data-x]")] : [];
    if (!buttons.length) return;
    const here = at(svg, event), width = here.plot.box[2] / here.pixel;
    const near = buttons.filter((button) => Math.abs(share(here.plot.x, Number(button.dataset.x)) - here.x) * width < NEAR_PIXELS);
    if (near.length) near[0].click();
  }

  function draw() {
    const { svg, data, plot, selected, read, brush } = chart;
    svg.querySelectorAll(".brushed, .ringed, .read").forEach((element) => element.remove());
    const parts = [];
    const [left, top, width, height] = plot.box;
    if (brush) {
      const ends = brush.map((end) => left + width * Math.min(1, Math.max(0, share(plot.x, end)))).sort((a, b) => a - b);
      parts.push(`<rect class="brushed" x="${ends[0]}" y="${top}" width="${ends[1] - ends[0]}" height="${height}"/>`);
    }
    const rings = data.row.flatMap((row, k) => (selected.has(row) && Math.abs(share(plot.y, data.y[k]) - 0.5) <= 0.5 ? [`M${place(plot, data.x[k], data.y[k]).map((p) => p.toFixed(1)).join(" ")}h0`] : []));
    if (rings.length) parts.push(`<path class="ringed" d="${rings.join("")}"/>`);
    if (read !== null) {
      const [x, y] = place(plot, data.x[read], data.y[read]);
      parts.push(`<circle class="read" cx="${x.toFixed(1)}" cy="${y.toFixed(1)}" r="6"/>`);
    }
    svg.insertAdjacentHTML("beforeend", parts.join(""));
  }

  function readDot(event) {
    const { svg, data, plot, readout } = chart;
    const here = at(svg, event);
    const width = plot.box[2] / here.pixel, height = plot.box[3] / here.pixel;
    let nearest = null, least = NEAR_PIXELS;
    data.row.forEach((_, k) => {
      const distance = Math.hypot((share(plot.x, data.x[k]) - here.x) * width, (share(plot.y, data.y[k]) - here.y) * height);
      if (distance < least) [nearest, least] = [k, distance];
    });
    chart.read = nearest;
    const unit = data.unit ? ` ${data.unit}` : "";
    readout.textContent = nearest === null ? "" :
      `Row ${data.row[nearest]}: ${data.what} ${short(data.x[nearest])}${unit}, ${data.reading} ${short(data.y[nearest])} ${data.reading_unit}, error ${data.size[nearest]} µm`;
    draw();
  }

  /** Selects the poses between two values, and rings them here and on the arm. */
  function select(low, high) {
    const { data, section } = chart;
    chart.brush = [low, high];
    const inside = data.row.map((_, k) => k).filter((k) => data.x[k] >= low && data.x[k] <= high);
    mark(inside.map((k) => data.row[k]));
    const mean = inside.reduce((sum, k) => sum + data.size[k], 0) / (inside.length || 1);
    section.querySelector(".selected").textContent = inside.length
      ? `${inside.length} of ${data.row.length} drawn poses, mean error ${short(mean)} µm` : "No pose is there.";
    section.querySelector("#brush-low").value = String(Number(low.toPrecision(6)));
    section.querySelector("#brush-high").value = String(Number(high.toPrecision(6)));
    section.querySelector("[data-act=leave_out_brushed]").hidden = !inside.length;
    document.querySelectorAll(".viewer").forEach((viewer) => viewer.dispatchEvent(new CustomEvent("armtrue-select", { detail: [...chart.selected] })));
  }

  function mark(rows) {
    chart.selected = new Set(rows);
    draw();
  }

  function brushes(figure) {
    let from = null;
    const valueAt = (event) => {
      const here = at(chart.svg, event);
      return value(here.plot.x, Math.min(1, Math.max(0, here.x)));
    };
    figure.addEventListener("pointerdown", (event) => {
      if (!at(chart.svg, event).inside) return;
      figure.setPointerCapture(event.pointerId);
      from = { x: event.clientX, value: valueAt(event) };
    });
    figure.addEventListener("pointermove", (event) => {
      if (from === null) return readDot(event);
      chart.brush = [from.value, valueAt(event)];
      draw();
    });
    figure.addEventListener("pointerup", (event) => {
      if (from !== null && Math.abs(event.clientX - from.x) >= LEAST_BRUSH) {
        select(...[from.value, valueAt(event)].sort((a, b) => a - b));
      }
      from = null;
    });
  }

  /** Has the charts inside a part of the page answer. */
  function start(slot) {
    const section = slot.querySelector("#looking");
    if (!section) return;
    const figure = section.querySelector(".look-figure"), svg = figure.querySelector("svg");
    chart = {
      section, svg, plot: JSON.parse(svg.dataset.plot), data: JSON.parse(section.querySelector("script").textContent),
      readout: section.querySelector(".readout"), selected: new Set(), read: null, brush: null,
    };
    brushes(figure);
    const ask = (detail) => document.dispatchEvent(new CustomEvent("armtrue-look", { detail }));
    section.querySelector("#look-variable").addEventListener("change", (event) => ask({ variable: event.target.value }));
    section.querySelector("#look-direction").addEventListener("change", (event) =>
      ask({ variable: section.querySelector("#look-variable").value, direction: event.target.value }));
    section.querySelector("[data-look=select]").addEventListener("click", () => {
      const ends = ["low", "high"].map((end) => section.querySelector(`#brush-${end}`).value);
      if (ends.every((end) => end !== "")) select(...ends.map(Number).sort((a, b) => a - b));
    });
  }

  document.addEventListener("pointermove", readValues);
  document.addEventListener("click", pressPeak);
  document.addEventListener("armtrue-brushed", (event) => {
    if (chart && chart.section.isConnected) mark(event.detail);
  });

  return {
    start,
    /** The variable of the chart and the ends of what is selected there. */
    range: () => ({ variable: chart.data.variable, low: chart.brush[0], high: chart.brush[1] }),
  };
})();
