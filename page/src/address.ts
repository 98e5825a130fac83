/** The address of the page: it follows state and look, and a link that is opened sets them. */

import { type Look, type Looks, readLook } from "./look";
import { fromAddress, type State, same, toAddress } from "./state";
import type { Store } from "./store";
import { STOPS } from "./tour";

const MOMENT = 100;

/** What the address says, and what in it means nothing. */
export function readAddress(): { state: State; look: Look; faults: string[] } {
  const { state, faults } = fromAddress(location.hash);
  const read = readLook(new URLSearchParams(location.hash.replace(/^#/, "")), STOPS.length);
  return { state, look: read.look, faults: [...faults, ...read.faults] };
}

/** The link that shows the same. */
export function linkTo(state: State, look: Look): string {
  return new URL(toAddress(state, look) || "/", location.origin).href;
}

/** Keep the address true; when another is opened, show its look and take its state. */
export function followAddress(store: Store, looks: Looks, show: (look: Look) => void): void {
  let writing: ReturnType<typeof setTimeout> | undefined;
  const write = () => {
    clearTimeout(writing);
    history.replaceState(null, "", toAddress(store.state, looks.now) || location.pathname);
  };
  // It follows when nothing has moved for a moment: it is slow to change, and browsers allow few changes a second.
  store.subscribe(() => {
    clearTimeout(writing);
    writing = setTimeout(write, MOMENT);
  });
  window.addEventListener("pagehide", write);
  looks.subscribe(write);
  window.addEventListener("hashchange", () => {
    const next = readAddress();
    show(next.look);
    if (!same(next.state, store.state)) store.replace(next.state);
  });
}
