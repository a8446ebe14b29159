import {chromium} from "playwright-core";
import {mkdtempSync} from "node:fs";
const [,, url, name] = process.argv;
const browser = await chromium.launch({executablePath: "/usr/bin/chromium", args: ["--no-sandbox","--disable-quic","--no-first-run","--disable-background-networking","--disable-component-update","--disable-sync","--use-angle=swiftshader","--enable-unsafe-swiftshader"]});
for (const [w,h,scheme] of [[1280,900,"light"],[1280,900,"dark"],[400,800,"dark"]]) {
  const page = await browser.newPage({viewport:{width:w,height:h}, colorScheme: scheme});
  page.on("console", m => console.log("console", m.type(), m.text())); page.on("pageerror", e => console.log("pageerror", e.message));
  const t=Date.now();
  await page.goto(url);
  await page.waitForSelector('body[data-ready=yes]', {timeout: 20000});
  console.log(name,w,scheme,"ready after",Date.now()-t);
  await page.waitForTimeout(800);
  await page.screenshot({path:`/tmp/web_shots/${name}-${w}-${scheme}-top.png`});
  const height = await page.evaluate(()=>document.documentElement.scrollHeight);
  for (let y=0;y<height;y+=h-100){ await page.evaluate(y=>scrollTo(0,y),y); await page.waitForTimeout(120);}
  await page.evaluate(()=>scrollTo(0,0));
  console.log("overflow", await page.evaluate(()=>document.documentElement.scrollWidth-innerWidth));
  await page.screenshot({path:`/tmp/web_shots/${name}-${w}-${scheme}-full.png`, fullPage:true});
  await page.close();
}
await browser.close();
