import js from "@eslint/js";
import tseslint from "typescript-eslint";

export default tseslint.config(
  {ignores: ["dist/", "node_modules/"]},
  js.configs.recommended,
  {
    files: ["src/**/*.ts", "test/**/*.ts"],
    extends: [tseslint.configs.strictTypeChecked],
    languageOptions: {parserOptions: {projectService: true, tsconfigRootDir: import.meta.dirname}},
    rules: {
      "@typescript-eslint/restrict-template-expressions": ["error", {allowNumber: true}],
      "@typescript-eslint/no-floating-promises": ["error", {allowForKnownSafeCalls: [{from: "package", name: "test", package: "node:test"}]}],
      // The compiler asks for a check of each element of an array; where the index is known to be good, "!" says so.
      "@typescript-eslint/no-non-null-assertion": "off",
    },
  },
  {
    files: ["**/*.mjs"],
    languageOptions: {globals: {process: "readonly", console: "readonly", setTimeout: "readonly", document: "readonly", window: "readonly", performance: "readonly", requestAnimationFrame: "readonly", Event: "readonly", MutationObserver: "readonly"}},
  },
);
