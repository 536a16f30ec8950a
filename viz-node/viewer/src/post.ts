// A request to the server that changes something.

/** Posts JSON; the words of a refusal, or null where it was done. */
export async function post(path: string, body: unknown): Promise<string | null> {
  const request = { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) };
  const answer = await fetch(path, request).catch(() => null);
  if (answer?.ok) return null;
  return answer ? (await answer.text()) || `${path} answered ${answer.status}` : "The viz-node does not answer.";
}
