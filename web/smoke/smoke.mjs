// Opens real pages in Chromium and works them: npm run smoke -- IDOL RECORDING OUT_DIR [CHROMIUM]
// Fails on any error of the page; leaves screenshots in OUT_DIR.
import assert from "node:assert/strict";
import {spawn, spawnSync} from "node:child_process";
import {mkdirSync, statSync} from "node:fs";
import {join, resolve} from "node:path";
import {pathToFileURL} from "node:url";
import {chromium} from "playwright-core";

const [idol, recording, out] = process.argv.slice(2, 5).map(path => resolve(path));
if (!out) throw new Error("usage: smoke.mjs IDOL RECORDING OUT_DIR [CHROMIUM]");
mkdirSync(out, {recursive: true});
const browser = await chromium.launch({executablePath: process.argv[5] ?? "/usr/bin/chromium", args: ["--no-sandbox", "--no-first-run", "--disable-quic",
  "--disable-background-networking", "--disable-component-update", "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]});
const problems = [];

async function open(url, {width = 1280, height = 900, colorScheme = "light"} = {}) {
  const page = await browser.newPage({viewport: {width, height}, colorScheme});
  page.on("pageerror", error => problems.push(`${url}: ${error.message}`));
  page.on("console", message => { if (message.type() === "error") problems.push(`${url}: ${message.text()}`); });
  page.on("request", request => { if (!/^(file|data|blob):|^http:\/\/127\.0\.0\.1:/.test(request.url())) problems.push(`${url} asks for ${request.url()}`); });
  await page.addInitScript(() => {
    window.poses = [];  // of a live page, each time it has drawn
    new MutationObserver(() => { window.poses.push(Number(document.body.dataset.poses)); })
      .observe(document, {attributes: true, subtree: true, attributeFilter: ["data-poses"]});
  });
  const begin = Date.now();
  await page.goto(url);
  await page.waitForSelector("body[data-ready=yes]");
  await page.waitForFunction(() => document.querySelector("canvas.scene") !== null);
  return {page, ms: Date.now() - begin};
}

/** Different colours in a canvas, and a number that changes when the picture does. */
const pixels = (page, selector) => page.evaluate(selector => {
  const canvas = document.querySelector(selector), copy = document.createElement("canvas");
  copy.width = canvas.width;
  copy.height = canvas.height;
  const context = copy.getContext("2d");
  context.drawImage(canvas, 0, 0);
  const words = new Uint32Array(context.getImageData(0, 0, copy.width, copy.height).data.buffer), seen = new Set();
  let sum = 0;
  words.forEach((word, i) => { seen.add(word); sum = (Math.imul(sum, 31) + word + i) | 0; });
  return {colours: seen.size, sum};
}, selector);

async function settle(page) { await page.waitForTimeout(400); }

async function checkReport(url, name) {
  const {page, ms} = await open(url);
  await settle(page);
  const before = {scene: await pixels(page, "canvas.scene"), events: await pixels(page, "canvas.events")};
  assert.ok(before.scene.colours > 20, "the 3D view is blank");
  assert.ok(before.events.colours > 5, "the event view is blank");
  const slider = page.getByLabel("Time in the recording");
  await slider.focus();
  await page.keyboard.press("Home");
  assert.ok(Number(await slider.inputValue()) < 0.2);
  for (let i = 0; i < 3; ++i) await page.keyboard.press("Shift+ArrowRight");
  await page.keyboard.press("ArrowRight");
  const time = Number(await slider.inputValue());
  await settle(page);
  const after = {scene: await pixels(page, "canvas.scene"), events: await pixels(page, "canvas.events")};
  assert.notEqual(after.scene.sum, before.scene.sum, "the frustum has not moved");
  assert.notEqual(after.events.sum, before.events.sum, "the events have not moved");
  const chart = page.locator(".plot .u-over").first(), cursor = page.locator(".plot .now").first();
  await page.locator(".plot").first().scrollIntoViewIfNeeded();  // curves are drawn when they come into view
  await settle(page);
  const end = Number(await slider.getAttribute("max"));
  const at = async () => { const [a, b] = [await chart.boundingBox(), await cursor.boundingBox()]; return (b.x - a.x) / a.width; };
  assert.ok(Math.abs(await at() - time / end) < 0.03, `the cursor of the curves is at ${await at()}, the slider at ${time / end}`);
  const box = await chart.boundingBox();
  await page.mouse.click(box.x + 0.75 * box.width, box.y + 40);
  assert.ok(Math.abs(Number(await slider.inputValue()) / end - 0.75) < 0.03, "a click on a curve sets the time");
  await page.keyboard.press("Escape");
  await page.evaluate(() => { document.activeElement?.blur(); window.scrollTo(0, 0); });
  await page.keyboard.press(" ");
  await page.waitForTimeout(1500);
  await page.keyboard.press(" ");
  assert.ok(Number(await slider.inputValue()) > 0.75 * end + 0.1, "space plays");
  const moves = await page.evaluate(async () => {
    const slider = document.querySelector(".timeline input"), begin = performance.now();
    for (let i = 0; i < 60; ++i) {
      slider.value = String(Number(slider.max) * i / 60);
      slider.dispatchEvent(new Event("input"));
      await new Promise(done => { requestAnimationFrame(done); });
    }
    return (performance.now() - begin) / 60;
  });
  await page.close();
  console.log(`${name}: open after ${ms} ms, a move of the slider takes ${moves.toFixed(0)} ms`);
  for (const [width, colorScheme] of [[1280, "light"], [1280, "dark"], [400, "light"], [400, "dark"]]) {
    const {page: shot} = await open(url, {width, height: width === 400 ? 860 : 900, colorScheme});
    await settle(shot);
    assert.ok(await shot.evaluate(() => document.documentElement.scrollWidth <= window.innerWidth), `wider than ${width} px`);
    await shot.screenshot({path: join(out, `${name}-${width}-${colorScheme}.png`)});
    await shot.close();
  }
}

/** The address that a program prints, once it does. */
function addressOf(stream) {
  return new Promise(found => {
    let text = "";
    stream.on("data", data => {
      text += data;
      const address = /http:\/\/127\.0\.0\.1:\d+\//.exec(text);
      if (address) found(address[0]);
    });
  });
}

const started = [];
process.on("exit", () => { for (const program of started) program.kill("SIGKILL"); });

function start(...args) {
  const program = spawn(idol, args);
  started.push(program);
  return program;
}

const over = program => new Promise(done => { program.on("exit", done); });

async function checkLive(dir) {
  const run = start("run", recording, "--out", dir, "--live", "--view"), ended = over(run);
  const {page} = await open(await addressOf(run.stderr));
  // On a busy computer the page may open when the run is nearly over: what counts is that it saw the path grow.
  await page.waitForSelector("body[data-live=over]", {timeout: 60000});
  const {grew, updates} = await page.evaluate(() => ({grew: window.poses, updates: Number(document.body.dataset.updates)}));
  assert.ok(grew.length >= 3, `the path does not grow: ${grew.join(", ")} poses`);
  assert.deepEqual(grew, [...grew].sort((a, b) => a - b));
  await settle(page);
  assert.ok((await pixels(page, "canvas.scene")).colours > 20 && (await pixels(page, "canvas.events")).colours > 5, "a view is blank");
  await page.screenshot({path: join(out, "live-1280.png")});
  assert.equal(await ended, 0);
  await page.close();
  console.log(`live: ${updates} updates, drawn ${grew.length} times, ${grew.at(-1)} poses`);
}

async function checkRuns(dirs) {
  const view = start("view", ...dirs), ended = over(view);
  const address = await addressOf(view.stdout);
  const {page} = await open(address);
  await settle(page);
  assert.equal(await page.locator("tbody tr").count(), dirs.length);
  assert.ok((await pixels(page, "canvas.scene")).colours > 20, "the overlay is blank");
  await page.screenshot({path: join(out, "compare-1280.png")});
  await page.locator("tbody a").first().click();
  await page.waitForSelector("canvas.events");
  await settle(page);
  assert.ok((await pixels(page, "canvas.events")).colours > 5, "no events from the server");
  await page.close();
  view.kill("SIGINT");
  assert.equal(await ended, 0);
}

const whole = join(out, "run"), short = join(out, "run_short");
spawnSync(idol, ["run", recording, "--out", whole]);
spawnSync(idol, ["run", recording, "--out", short, "--to", "4"]);
await checkReport(pathToFileURL(join(whole, "report.html")).href, "report");
await checkRuns([whole, short]);
await checkLive(join(out, "run_live"));
await browser.close();
console.log(`report.html of ${recording}: ${(statSync(join(whole, "report.html")).size / 1e6).toFixed(1)} MB`);
assert.deepEqual(problems, []);
console.log("all well");
