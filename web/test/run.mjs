// Bundles the tests, which are typed too, and runs them with node's own test runner.
import {spawnSync} from "node:child_process";
import {mkdtempSync, readdirSync, rmSync} from "node:fs";
import {tmpdir} from "node:os";
import {join} from "node:path";
import {build} from "esbuild";

const here = import.meta.dirname, out = mkdtempSync(join(tmpdir(), "idol-page-"));
const tests = readdirSync(here).filter(name => name.endsWith(".test.ts"));
await build({entryPoints: tests.map(name => join(here, name)), bundle: true, platform: "node", format: "esm", outdir: out, outExtension: {".js": ".mjs"}, logLevel: "error"});
const {status} = spawnSync(process.execPath, ["--test", ...tests.map(name => join(out, name.replace(/ts$/, "mjs")))], {stdio: "inherit"});
rmSync(out, {recursive: true});
process.exit(status ?? 1);
