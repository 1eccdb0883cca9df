// Asking the server. A refusal is an Error with the server's words; `status` 409 is a conflict.
const HEADERS = { "X-Svbrdf": "1" };

async function ask(path, options = {}) {
  let response;
  try {
    response = await fetch(`/api/${path}`, { headers: HEADERS, ...options });
  } catch {
    throw new Error("meshlab-svbrdf view does not answer; is it still running?");
  }
  if (response.ok) return response;
  let message = `${path}: ${response.status}`;
  try { message = (await response.json()).message; } catch { /* not ours */ }
  throw Object.assign(new Error(message), { status: response.status });
}

export const get = async (path) => (await ask(path)).json();
export const post = async (path, given) =>
  (await ask(path, { method: "POST", body: JSON.stringify(given) })).json();
export const text = async (path) => (await ask(path)).text();
export const picture = async (path) => createImageBitmap(await (await ask(path)).blob());

// A typed array, and the headers that came with it
export async function array(path, Type) {
  const response = await ask(path);
  return [new Type(await response.arrayBuffer()), response.headers];
}
