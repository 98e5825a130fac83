import { defineConfig } from "vite";

export default defineConfig({
  build: {
    outDir: "../src/revline/web/page",
    emptyOutDir: true,
    modulePreload: { polyfill: false },
    assetsInlineLimit: 0,
    target: "es2022",
  },
  server: { proxy: { "/api": "http://127.0.0.1:8765" } },
});
