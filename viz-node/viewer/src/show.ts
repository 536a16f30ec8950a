// A request to generate the next steps otherwise, made from a panel.

import { refresh } from "./frame";
import { post } from "./post";
import { drawMessage } from "./status";

/** What became of the last one. */
export interface Asked {
  message: string;
  refused: boolean;
}

/** Asks the generator-node to show the run so; `asked` is told what came of it. */
export async function askToShow(change: object, asked: Asked): Promise<void> {
  const refusal = await post("api/show", change);
  Object.assign(asked, { message: refusal ?? "from the next step on", refused: refusal !== null });
  refresh();
}

export const drawAsked = (id: string, { message, refused }: Asked): void => drawMessage(id, message, refused);
