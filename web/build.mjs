// Bundles src/ into one page without anything from outside: dist/report.html, or the file after --out.
import {createHash} from "node:crypto";
import {mkdirSync, readFileSync, readdirSync, writeFileSync} from "node:fs";
import {dirname, join} from "node:path";
import {build} from "esbuild";

const here = import.meta.dirname;

// Of all that decides what the page is, by name: CMake computes the same (cmake/CheckPage.cmake).
function sourcesHash() {
  const names = [...readdirSync(join(here, "src")).map(name => `src/${name}`), "build.mjs", "package-lock.json"].sort();
  const lines = names.map(name => `${name} ${createHash("sha256").update(readFileSync(join(here, name))).digest("hex")}\n`);
  return createHash("sha256").update(lines.join("")).digest("hex");
}

async function bundle(entry, options) {
  const result = await build({entryPoints: [join(here, "src", entry)], bundle: true, minify: true, write: false,
    legalComments: "none", charset: "utf8", ...options});
  return result.outputFiles[0].text.trim();
}

// Their licences ask for it.
function notices() {
  return ["three", "uplot"].map(name => {
    const folder = join(here, "node_modules", name);
    const {version} = JSON.parse(readFileSync(join(folder, "package.json"), "utf8"));
    return `${name} ${version}\n${readFileSync(join(folder, "LICENSE"), "utf8").trim()}`;
  }).join("\n\n").replaceAll("--", "- -");
}

const out = process.argv.includes("--out") ? process.argv[process.argv.indexOf("--out") + 1] : join(here, "dist", "report.html");
const parts = {
  "@HASH@": sourcesHash(),
  "@NOTICES@": notices(),
  "@STYLE@": await bundle("style.css", {loader: {".css": "css"}}),
  "@SCRIPT@": await bundle("main.ts", {format: "iife", target: "es2022"}),
};
let page = readFileSync(join(here, "src", "page.html"), "utf8");
for (const [mark, text] of Object.entries(parts)) page = page.replace(mark, () => text);
mkdirSync(dirname(out), {recursive: true});
writeFileSync(out, page);
console.log(`${out}: ${Math.round(page.length / 1024)} KiB`);
