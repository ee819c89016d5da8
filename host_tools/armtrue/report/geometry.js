// Orthographic views of points in space, without a page.
"use strict";

/** Rows of the view: right, up and towards the eye, for angles in radians. Axis z stays upright. */
function viewAxes(azimuth, elevation) {
  const ca = Math.cos(azimuth), sa = Math.sin(azimuth), ce = Math.cos(elevation), se = Math.sin(elevation);
  return [[-sa, ca, 0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]];
}

/** Screen x and y of a point, `view` being {axes, centre, scale, left, top} with lengths in the points' unit. */
function project(view, x, y, z) {
  const [right, up] = view.axes;
  const dx = x - view.centre[0], dy = y - view.centre[1], dz = z - view.centre[2];
  return [
    view.left + view.scale * (right[0] * dx + right[1] * dy + right[2] * dz),
    view.top - view.scale * (up[0] * dx + up[1] * dy + up[2] * dz),
  ];
}

/** The round number (1, 2 or 5 times a power of ten) next to `value`, `steps` further up or down. */
function roundNumber(value, steps = 0) {
  const factors = [1, 2, 5];
  const power = Math.floor(Math.log10(value) + 1e-9);
  const head = value / 10 ** power;
  const index = (head < 1.5 ? 0 : head < 3.5 ? 1 : head < 7.5 ? 2 : 3) + steps + 3 * power;
  return factors[((index % 3) + 3) % 3] * 10 ** Math.floor(index / 3);
}

/** Smallest and largest coordinates of points [x, y, z, x, …]. */
function boundsOf(points) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < points.length; i++) {
    low[i % 3] = Math.min(low[i % 3], points[i]);
    high[i % 3] = Math.max(high[i % 3], points[i]);
  }
  return { low, high };
}

/** The value below which `share` of a list lies. */
function quantile(values, share) {
  const sorted = Float64Array.from(values).sort();
  return sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))];
}
