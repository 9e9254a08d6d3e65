// As much of a browser as potree-core needs to load an octree under Node: web
// workers, which here run in a context of their own but on the same thread, and
// the objects by which the package makes them from source text.

import vm from 'node:vm';

class TextBlob {
  constructor(parts) {
    this.text = parts.join('');
  }
}

class ContextWorker {
  constructor(blob) {
    this.context = vm.createContext({
      console,
      performance,
      postMessage: (data) => setImmediate(() => this.onmessage({ data })),
    });
    this.context.self = this.context;
    vm.runInContext(blob.text, this.context);
  }

  postMessage(data) {
    this.context.onmessage({ data });
  }

  terminate() {}
}

globalThis.self = {
  Blob: TextBlob,
  URL: { createObjectURL: (blob) => blob, revokeObjectURL: () => {} },
  Worker: ContextWorker,
};
