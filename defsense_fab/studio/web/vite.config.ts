import preact from "@preact/preset-vite";
import { defineConfig, type Plugin } from "vite";
import { licenses } from "./licenses.ts";

// Reports contain three.js and report.js only, so that modules of both pages are in three.js.
const SHARED_MODULES =
  /\/node_modules\/three\/|\/src\/scene\/(body-geometry|body-layer|camera-keys|camera-rig|coarse-index|contact-shadow|order|ray|shading|theme|tube)\.ts$/;

/** Return a plugin that refuses a report.js that imports more than a report contains. */
function reportImports(): Plugin {
  return {
    name: "report-imports",
    generateBundle(_options, bundle) {
      const report = bundle["report.js"];
      const imports = report?.type === "chunk" ? report.imports.join(", ") : "nothing";
      if (imports !== "three.js") this.error(`report.js imports ${imports}, not three.js alone`);
    },
  };
}

/** Return a plugin that gives the view cube's package the module three-for-cube in place of three. */
function threeForCube(): Plugin {
  return {
    name: "three-for-cube",
    enforce: "pre",
    resolveId(source, importer) {
      const isCube = importer?.includes("/node_modules/three-viewport-gizmo/");
      return source === "three" && isCube ? this.resolve("/src/scene/three-for-cube.ts") : null;
    },
  };
}

// The built page is committed and shipped in the wheel; its names have no hashes, so that a
// rebuild changes contents only.
export default defineConfig({
  base: "./",
  plugins: [threeForCube(), preact(), licenses(), reportImports()],
  build: {
    outDir: "../../data/web",
    emptyOutDir: true,
    target: "es2022",
    chunkSizeWarningLimit: 1500,
    rollupOptions: {
      input: { index: "index.html", report: "src/report/report.ts" },
      output: {
        entryFileNames: "[name].js",
        chunkFileNames: "[name].js",
        assetFileNames: "[name][extname]",
        manualChunks: (id) => (SHARED_MODULES.test(id) ? "three" : undefined),
      },
    },
  },
  server: { proxy: { "/socket": { target: "ws://127.0.0.1:8090", ws: true } } },
});
