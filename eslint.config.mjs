import js from "@eslint/js";
import globals from "globals";

export default [
  { ignores: ["**/.*/", "build/", "dist/", "mutants/"] },
  js.configs.recommended,
  {
    files: ["haptigraph/**/*.js"],
    languageOptions: { ecmaVersion: 2025, sourceType: "module", globals: globals.browser },
    linterOptions: { reportUnusedDisableDirectives: "error" },
    rules: {
      "eqeqeq": "error",
      "no-shadow": "error",
      "no-unused-vars": ["error", { argsIgnorePattern: "^_" }],
      "no-var": "error",
      "prefer-const": ["error", { destructuring: "all" }],
    },
  },
];
