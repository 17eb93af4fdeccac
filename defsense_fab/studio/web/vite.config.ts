import preact from "@preact/preset-vite";
import { defineConfig } from "vite";

// The built page is committed and shipped in the wheel; its names have no hashes, so that a
// rebuild changes contents only.
export default defineConfig({
  base: "./",
  plugins: [preact()],
  build: {
    outDir: "../../data/web",
    emptyOutDir: true,
    target: "es2022",
    chunkSizeWarningLimit: 1500,
    rollupOptions: {
      output: {
        entryFileNames: "[name].js",
        chunkFileNames: "[name].js",
        assetFileNames: "[name][extname]",
        manualChunks: (id) => (id.includes("/node_modules/three/") ? "three" : undefined),
      },
    },
  },
  server: { proxy: { "/socket": { target: "ws://127.0.0.1:8090", ws: true } } },
});
