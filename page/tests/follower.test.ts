import { describe, expect, it } from "vitest";
import { Follower } from "../src/api";

const turn = () => new Promise((resolve) => setTimeout(resolve));

describe("the follower", () => {
  it("keeps one request in flight and sends the newest next", async () => {
    const asked: number[] = [];
    const shown: number[] = [];
    const answers: ((value: number) => void)[] = [];
    const follower = new Follower<number, number>(
      (n) => {
        asked.push(n);
        return new Promise((resolve) => answers.push(resolve));
      },
      (answer) => shown.push(answer),
      () => undefined,
    );
    for (const n of [1, 2, 3, 4]) follower.follow(n);
    expect(asked).toEqual([1]);
    answers[0]?.(10);
    await turn();
    expect(asked).toEqual([1, 4]);
    answers[1]?.(40);
    await turn();
    expect(shown).toEqual([10, 40]);
    expect(follower.busy).toBe(false);
  });

  it("goes on after a failure", async () => {
    const failed: unknown[] = [];
    const shown: number[] = [];
    const follower = new Follower<number, number>(
      (n) => (n < 0 ? Promise.reject(new Error("no")) : Promise.resolve(n)),
      (answer) => shown.push(answer),
      (error) => failed.push(error),
    );
    follower.follow(-1);
    follower.follow(2);
    await turn();
    expect(failed).toHaveLength(1);
    expect(shown).toEqual([2]);
  });
});
