// Shapes between the simulated ones: a piecewise cubic curve through them, whose slope at each is
// that of the parabola through it and its neighbours.

// Weights of the shapes at the increasing places `at` (the first is rest, at 0) for place t.
function weightsAt(at, t) {
  const n = at.length;
  const x = Math.min(Math.max(t, at[0]), at[n - 1]);
  let i = 0;
  while (i < n - 2 && x > at[i + 1]) i++;
  const h = at[i + 1] - at[i];
  const u = (x - at[i]) / h;
  const weights = new Array(n).fill(0);
  if (n === 2) {
    weights[0] = 1 - u;
    weights[1] = u;
    return weights;
  }
  weights[i] += (1 + 2 * u) * (1 - u) ** 2;
  weights[i + 1] += u * u * (3 - 2 * u);
  addSlope(weights, at, i, h * u * (1 - u) ** 2);
  addSlope(weights, at, i + 1, h * u * u * (u - 1));
  return weights;
}

// Adds `share` times the slope at place i.
function addSlope(weights, at, i, share) {
  const middle = Math.min(Math.max(i, 1), at.length - 2);
  for (let j = middle - 1; j <= middle + 1; j++) {
    const others = [middle - 1, middle, middle + 1].filter((k) => k !== j);
    const [a, b] = others.map((k) => at[k]);
    weights[j] += (share * (2 * at[i] - a - b)) / ((at[j] - a) * (at[j] - b));
  }
}

// start + the sum of weights times ways, into `out`.
function blend(out, start, ways, weights) {
  out.set(start);
  ways.forEach((way, k) => {
    const weight = weights[k];
    if (weight) for (let i = 0; i < out.length; i++) out[i] += weight * way[i];
  });
}
