import { defineConfig } from "vite";

// One classic script, to be put into a document: modules are not loaded from files.
export default defineConfig({
  build: {
    outDir: "dist",
    emptyOutDir: false,
    copyPublicDir: false,
    target: "es2022",
    lib: { entry: "src/embed.ts", formats: ["iife"], name: "lamina", fileName: () => "embed.js" },
  },
});
