// Color maps, the same as in the pictures of the report: reversed magma for errors, viridis
// for strains.
const MAPS = {
  error: "fcfdbf fecf92 fe9f6d f7705c de4968 b73779 8c2981 641a80 3b0f70 140e36 000004",
  strain: "440154 482475 414487 355f8d 2a788e 21918c 22a884 44bf70 7ad151 bddf26 fde725",
};

// Red, green and blue from 0 to 1 (linear) of a map in 256 steps.
function colorTable(name) {
  const stops = MAPS[name].split(" ").map((hex) => new THREE.Color("#" + hex));
  const table = new Float32Array(3 * 256);
  for (let i = 0; i < 256; i++) {
    const x = (i / 255) * (stops.length - 1);
    const k = Math.min(Math.floor(x), stops.length - 2);
    stops[k].clone().lerp(stops[k + 1], x - k).toArray(table, 3 * i);
  }
  return table;
}

function cssRamp(name) {
  return "linear-gradient(90deg," + MAPS[name].split(" ").map((hex) => "#" + hex).join(",") + ")";
}
