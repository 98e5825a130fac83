import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import type { Found, PartName } from "../src/api";
import { Following, type Listener } from "../src/following";
import { DEFAULTS } from "../src/state";
import { Store } from "../src/store";

type Answer = (parts: PartName[]) => Response | Promise<Response>;

const MAP = { of: "map", line: "about 25" };
const whole: Answer = (parts) =>
  Response.json({ parts: Object.fromEntries(parts.map((part) => [part, part === "map" ? MAP : { of: part }])) });
const cut: Answer = () => new Response('{"parts":{"loop":', { headers: { "content-type": "application/json" } });

/** A page's follower before a server that answers views as it is told to, each way once, and then whole. */
function follow(...ways: Answer[]) {
  const said: string[] = [];
  const shown: Found[] = [];
  const asked: PartName[][] = [];
  const listener: Listener = {
    live: ({ found }) => shown.push({ ...found }),
    slow: ({ found }) => shown.push({ ...found }),
    refused: ({ detail }) => said.push(`refused: ${detail}`),
    lost: (why, wait) => said.push(`lost: ${why}, ${wait}`),
    told: (why) => said.push(`told: ${why}`),
    back: () => said.push("back"),
    broken: (error) => said.push(`broken: ${error}`),
    stage: (stage) => said.push(stage),
  };
  vi.stubGlobal("fetch", (path: string, { body }: { body?: string }) => {
    if (path === "/api/v1/health") return Promise.resolve(Response.json({}));
    const { parts } = JSON.parse(body ?? "") as { parts: PartName[] };
    asked.push(parts);
    return Promise.resolve((ways.shift() ?? whole)(parts));
  });
  const store = new Store(DEFAULTS);
  const following = new Following(store, listener);
  store.subscribe(() => following.move());
  following.start();
  const rest = () => vi.advanceTimersByTimeAsync(3000);
  return { said, shown, asked, store, following, listener, rest };
}

describe("what follows the server", () => {
  beforeEach(() => void vi.useFakeTimers());
  afterEach(() => {
    vi.useRealTimers();
    vi.unstubAllGlobals();
  });

  it("asks for live parts, then the map, then what is slow", async () => {
    const { said, asked, rest } = follow();
    await rest();
    expect(asked.map((parts) => parts.includes("loop"))).toEqual([true, false, false]);
    expect(asked[1]).toEqual(["map"]);
    expect(asked[2]).toContain("peaks");
    expect(said).toEqual(["drawn", "settled"]);
  });

  it("asks again at once where an answer was cut off, later where it is so again, and goes on", async () => {
    const { said, shown, rest } = follow(cut, cut);
    await vi.advanceTimersByTimeAsync(500);
    const why = "The server's answer was cut off";
    expect(said).toEqual([`lost: ${why}, 0`, "back", `lost: ${why}, 4`]);
    expect(shown).toEqual([]);
    await rest();
    await rest();
    expect(said.slice(3)).toEqual(["back", "drawn", "settled"]);
    expect(shown.at(-1)?.loop).toEqual({ of: "loop" });
  });

  it("takes what is moved meanwhile, and asks no more for what was lost", async () => {
    const { said, shown, asked, store, rest } = follow(cut, cut);
    await vi.advanceTimersByTimeAsync(500);
    store.set({ kp: 0.5 });
    await vi.advanceTimersByTimeAsync(500);
    expect(asked.filter((parts) => parts.includes("loop"))).toHaveLength(3);
    expect(shown.length).toBeGreaterThan(0);
    const known = asked.length;
    await rest();
    await rest();
    expect(asked).toHaveLength(known);
    expect(said.filter((text) => text.startsWith("lost"))).toHaveLength(2);
    expect(said.at(-1)).toBe("settled");
  });

  it.each([
    ["its steady speeds, which hold for both", { throttle_deg: 60 }, { of: "map" }],
    ["nothing", { load_n_m: 5 }, undefined],
  ])("keeps of the map of another state %s, after a refused one too", async (_, patch, kept) => {
    const { said, shown, store, rest } = follow();
    await rest();
    expect(shown.at(-1)?.map).toEqual(MAP);
    const problem = { detail: "no such throttle", status: 422 };
    vi.stubGlobal("fetch", () => Promise.resolve(Response.json(problem, { status: 422 })));
    store.set({ throttle_deg: 2000 });
    await rest();
    expect(said).toContain("refused: no such throttle");
    const before = shown.length;
    vi.stubGlobal("fetch", (_: string, { body }: { body: string }) => {
      const { parts } = JSON.parse(body) as { parts: PartName[] };
      return parts.includes("map") ? new Promise(() => {}) : Promise.resolve(whole(parts));
    });
    store.set({ throttle_deg: 25, ...patch });
    await rest();
    expect(shown).toHaveLength(before + 1);
    expect(shown.at(-1)?.loop).toBeDefined();
    expect(shown.at(-1)?.map).toEqual(kept);
  });

  it("asks for slow parts again where there was no time for them, and not where they took too long", async () => {
    const refusal =
      (type: string): Answer =>
      () =>
        Response.json({ type: `/problems/${type}`, detail: type, status: 503 }, { status: 503 });
    const { said, shown, store, rest } = follow(whole, whole, refusal("too-busy"));
    await rest();
    expect(said).toEqual(["drawn", "told: too-busy", "settled"]);
    await rest();
    expect(shown.at(-1)?.peaks).toBeDefined();
    expect(said).toHaveLength(4);
    const late = follow(whole, whole, refusal("out-of-time"));
    await rest();
    await rest();
    await rest();
    expect(late.said).toEqual(["drawn", "told: out-of-time", "settled"]);
    expect(late.asked).toHaveLength(3);
    expect(store.state.kp).toBe(DEFAULTS.kp);
  });

  it("says why the first view of an engine takes long, and not of an engine that is ready", async () => {
    const slow: Answer = (parts) => new Promise((done) => setTimeout(() => done(whole(parts)), 2000));
    const { said, store, rest } = follow(whole, whole, whole, slow);
    await rest();
    store.set({ engine: "lee1995-generic" });
    await vi.advanceTimersByTimeAsync(1600);
    expect(said.at(-1)).toBe(
      "told: The first view of lee1995-generic takes longer where the engine is compiled first, which is done once.",
    );
    await rest();
    expect(said.filter((text) => text.startsWith("told"))).toHaveLength(1);
    expect(said.at(-1)).toBe("settled");
    store.set({ kp: 0.5 });
    await rest();
    expect(said.filter((text) => text.startsWith("told"))).toHaveLength(1);
  });

  it("leaves live parts as they are where slow ones fail, and says nothing of those of another state", async () => {
    const fault: Answer = () => Response.json({ detail: "a fault", status: 500 }, { status: 500 });
    const { said, asked, store, rest } = follow(whole, whole, fault);
    await rest();
    expect(said).toEqual(["drawn", "told: a fault", "settled"]);
    let fail: (answer: Response) => void = () => {};
    vi.stubGlobal("fetch", (_: string, { body }: { body: string }) => {
      const { parts } = JSON.parse(body) as { parts: PartName[] };
      asked.push(parts);
      if (!parts.includes("peaks") || asked.length > 6) return Promise.resolve(whole(parts));
      return new Promise<Response>((answer) => {
        fail = answer;
      });
    });
    store.set({ load_n_m: 3 });
    await rest();
    store.set({ load_n_m: 4 });
    fail(await fault([]));
    await rest();
    expect(said.filter((text) => text.startsWith("told"))).toHaveLength(1);
    expect(said.at(-1)).toBe("settled");
  });

  it("says that it failed to show a view, and shows the next", async () => {
    const { said, shown, store, listener, rest } = follow();
    const { live } = listener;
    listener.live = () => {
      throw new Error("nothing to draw on");
    };
    await rest();
    expect(said).toEqual(["broken: Error: nothing to draw on", "settled"]);
    listener.live = live;
    store.set({ kp: 0.5 });
    await rest();
    expect(shown.at(-1)?.margins).toBeDefined();
    expect(said.at(-1)).toBe("settled");
  });
});
