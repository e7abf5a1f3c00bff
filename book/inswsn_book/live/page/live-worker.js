/* Python in the page: a worker that runs the cells of one lesson. What a reader types runs here alone. */
"use strict";

const here = new URL("live/", self.location);

/** Python, with numpy and the library, once. */
const ready = (async () => {
  importScripts(new URL("pyodide.js", here).href);
  const python = await loadPyodide({ indexURL: here.href });
  for (const name of ["numpy.zip", "inswsn.zip"]) {
    const answer = await fetch(new URL(name, here));
    if (!answer.ok) throw new Error(`${name} could not be loaded: ${answer.status} ${answer.statusText}`);
    python.unpackArchive(await answer.arrayBuffer(), "zip", { extractDir: "/packages" });
  }
  python.runPython(`
import sys
sys.path.insert(0, "/packages")
from inswsn_book.live import absent
absent.block()
`);
  return python;
})();

/** The cells of the page's lesson: its names, and what has run. */
const lesson = ready.then((python) => python.runPython(`
import json
from inswsn_book.live import cells
_lesson, _plan = cells.lesson_in_the_page(), cells.Plan()
lambda asked: map(json.dumps, cells.answer(_lesson, _plan, json.loads(asked)))
`));

/** Call a function of the library, "module:name", with values that JSON can say. */
const call = async (place, values) => (await ready).runPython(`
import importlib, json
def _call(place, values):
    module, _, name = place.partition(":")
    try:
        return json.dumps({"value": getattr(importlib.import_module(module), name)(*json.loads(values))})
    except Exception as error:
        return json.dumps({"error": str(error)})
_call
`)(place, JSON.stringify(values));

self.onmessage = async ({ data: { id, run, place, values } }) => {
  try {
    if (place) {
      self.postMessage({ id, ...JSON.parse(await call(place, values)), ended: true });
      return;
    }
    const answers = (await lesson)(JSON.stringify(run));
    for (const said of answers) self.postMessage({ id, ...JSON.parse(said) });
    answers.destroy();
    self.postMessage({ id, ended: true });
  } catch (error) {
    self.postMessage({ id, ended: true, failed: String(error.message || error) });
  }
};
