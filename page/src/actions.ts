/** What the buttons at the head do: undo and redo, reset, a link, a study file, the theme. */

import { linkTo } from "./address";
import { fetchText } from "./api";
import type { Looks } from "./look";
import { need } from "./parts";
import { save } from "./plot";
import { DEFAULTS } from "./state";
import type { Store } from "./store";

export function offerUndo(store: Store): void {
  const undo = need<HTMLButtonElement>("undo");
  const redo = need<HTMLButtonElement>("redo");
  store.subscribe(() => {
    const held = document.activeElement;
    undo.disabled = !store.canUndo;
    redo.disabled = !store.canRedo;
    // A button that can do no more gives the focus to the other, so that the keyboard is not lost.
    if (held === undo && undo.disabled) redo.focus();
    if (held === redo && redo.disabled) undo.focus();
  });
  undo.addEventListener("click", () => store.undo());
  redo.addEventListener("click", () => store.redo());
  need("reset").addEventListener("click", () => store.replace(DEFAULTS));
  document.addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z") return;
    event.preventDefault();
    if (event.shiftKey) store.redo();
    else store.undo();
  });
}

/** Skip to the plots without a change of the address, which would be read as a link. */
export function offerSkip(): void {
  document.querySelector(".skip")?.addEventListener("click", (event) => {
    event.preventDefault();
    need("plots").focus();
  });
}

/** Copy a link that shows the same; where that is not allowed, tell it. */
export function offerLink(store: Store, looks: Looks, tell: (text: string) => void): void {
  const button = need<HTMLButtonElement>("link");
  button.addEventListener("click", async () => {
    const link = linkTo(store.state, looks.now);
    try {
      await navigator.clipboard.writeText(link);
      button.textContent = "Copied";
      setTimeout(() => {
        button.textContent = "Copy link";
      }, 1500);
    } catch {
      tell(`The link to this view: ${link}`);
    }
  });
}

/** Save the state as a study file, and its engine beside it where it was changed. */
export function offerStudyFile(store: Store, failed: (error: unknown) => void, saved: (text: string) => void): void {
  const saveText = async (kind: "study" | "engine") => {
    const text = await fetchText(`/api/v1/${kind}-file`, store.state);
    save(new Blob([text], { type: "application/toml" }), `${kind}.toml`);
  };
  need("study").addEventListener("click", async () => {
    try {
      await saveText("study");
      if (Object.keys(store.state.parameters).length > 0) await saveText("engine");
      saved(
        "Saved as study.toml. A study has its own controllers, steps and times: the page's stand in it as comments.",
      );
    } catch (error) {
      failed(error);
    }
  });
}

/** Light or dark, at first as the system is. */
export function offerTheme(restyle: () => void): void {
  const theme = need<HTMLButtonElement>("theme");
  const set = (on: boolean) => {
    document.documentElement.dataset.theme = on ? "dark" : "light";
    theme.setAttribute("aria-pressed", String(on));
    restyle();
  };
  theme.addEventListener("click", () => set(document.documentElement.dataset.theme !== "dark"));
  set(matchMedia("(prefers-color-scheme: dark)").matches);
}
