/** What can be set of an engine, asked of the server once for each. */

import { fetchJson } from "./api";
import type { Parameter } from "./engine";
import type { Named } from "./stability";

export interface Offered {
  engines: string[];
  parameters: Parameter[];
  controllers: (Named & { what: string })[];
}

export class Offers {
  private asked = "";

  constructor(
    private readonly take: (offered: Offered) => void,
    private readonly fail: (error: unknown) => void,
  ) {}

  /** Ask for the engine shown, where it was not asked for yet. */
  ask(engine: string): void {
    if (this.asked === engine) return;
    this.asked = engine;
    fetchJson<Offered>(`/api/v1/parameters?engine=${encodeURIComponent(engine)}`).then(
      (offered) => {
        if (this.asked === engine) this.take(offered);
      },
      (error) => {
        if (this.asked === engine) this.asked = "";
        this.fail(error);
      },
    );
  }
}
