import { defineConfig } from "vite";

// Stable names and no inlined data: the viz-node serves these files from its binary, under a policy that allows no inline code.
// Apart, so that its test loads it alone.
const manualChunks = { draft_size: ["src/draft_size.ts"] };

export default defineConfig({
  base: "./",
  build: {
    outDir: "dist",
    // The engine is built apart.
    emptyOutDir: false,
    target: "es2022",
    modulePreload: false,
    assetsInlineLimit: 0,
    rollupOptions: {
      output: { entryFileNames: "viewer.js", chunkFileNames: "[name].js", assetFileNames: "viewer[extname]", manualChunks },
    },
  },
  worker: { format: "es", rollupOptions: { output: { entryFileNames: "worker.js" } } },
});
