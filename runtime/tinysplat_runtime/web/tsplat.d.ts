/** A pinhole camera: OpenCV's axes, pixels whose first has its centre at (0.5, 0.5). */
export interface Camera {
  width: number;
  height: number;
  fx: number;
  fy: number;
  cx: number;
  cy: number;
  skew: number;
  /** Camera to world, 4 × 4 row by row. */
  c2w: Float64Array;
}

/** Where a layer's Gaussians lie in the arrays: `count` from `offset` on, views outermost, then rows. */
export interface LayerShape {
  /** 0 views of 0 × 0 for Gaussians that belong to no pixels. */
  views: number;
  height: number;
  width: number;
  count: number;
  offset: number;
  degree: number;
  cameras: Camera[];
}

/** Gaussians of all layers, one after the other. */
export interface Scene {
  count: number;
  /** SH degree, 0 to 4: the highest of the layers. */
  degree: number;
  /** 3 each, relative to `origin`, in the file's world. */
  means: Float32Array;
  /** 4 each: w, x, y, z. */
  quats: Float32Array;
  /** 3 each, linear. */
  scales: Float32Array;
  /** Linear. */
  opacities: Float32Array;
  /** 3(degree + 1)² each: red, green and blue of every function of the 3DGS basis. */
  sh: Float32Array;
  /** World position of means' zero. */
  origin: ArrayLike<number>;
  cameras: Camera[];
  layers: LayerShape[];
  /** What the scene's maker says: unit, attribution, licence, refined, antialiased, pruned. */
  notes: Record<string, string>;
  mode: "gaussians" | "photos" | "lossless" | "list";
  /** Of the whole file. */
  bytes: number;
  /** Names of pictures that are not at hand. */
  missing: string[];
}

/** What is accepted before memory is taken. */
export interface Limits {
  /** Gaussians of the views that are decoded, over all layers. */
  maxPixels: number;
  /** Bytes that decoding takes. */
  maxMemory: number;
  /** Views that are decoded. */
  maxViews: number;
  maxLayers: number;
  /** Gaussians for each byte at hand, beyond the first million; Infinity by default. */
  maxPerByte: number;
}

/** Photos that a network is to make Gaussians of. */
export interface NetworkRequest {
  /** RGB in [0, 1], pixel by pixel. */
  photos: Float32Array[];
  /** Of every photo. */
  width: number;
  height: number;
  cameras: Camera[];
  near: number;
  far: number;
  /** Of the network, and the SHA-256 of its ONNX file. */
  name: string;
  sha256: string;
}

/** What a network made: layers of per-pixel Gaussians, means relative to `origin`. */
export interface Prediction {
  layers: {
    height: number;
    width: number;
    degree: number;
    cameras: Camera[];
    means: Float32Array;
    quats: Float32Array;
    scales: Float32Array;
    opacities: Float32Array;
    sh: Float32Array;
  }[];
  origin: ArrayLike<number>;
}

export interface Options {
  /** Decode from so many first bytes alone: FORMAT.md, "Prefixes". */
  maxBytes?: number;
  /** Decode these views alone. */
  views?: number[];
  signal?: AbortSignal;
  /** Workers that decode pictures; 0 for none. */
  threads?: number;
  limits?: Partial<Limits>;
  /** Decode what is intact of a damaged file. */
  recover?: boolean;
  /** Runs the network of files of mode photos. */
  network?: (request: NetworkRequest) => Promise<Prediction>;
  /** Is told every picture once it is decoded. */
  onPicture?: (name: string) => void;
}

/** A file that is damaged, cut short, foreign or beyond the limits. */
export class TsplatError extends Error {
  constructor(message: string, section?: string, offset?: number);
  /** Such as `LAYR[0]`. */
  section?: string;
  /** In bytes, in the section. */
  offset?: number;
}

/** Decode a file. */
export function decode(bytes: ArrayBuffer | ArrayBufferView, options?: Options): Promise<Scene>;

/** Decode a file while it arrives: ever better scenes, at last that of the whole file. */
export function decodeStream(
  chunks: AsyncIterable<Uint8Array> | ReadableStream<Uint8Array>,
  options?: Options,
): AsyncGenerator<Scene & { received: number }>;

/** What a file holds, from its metadata alone. */
export function inspect(
  bytes: ArrayBuffer | ArrayBufferView,
  limits?: Partial<Limits>,
): {
  version: string;
  mode: string;
  profile: string;
  qp: number;
  bytes: number;
  origin: Float64Array;
  cameras: Camera[];
  notes: Record<string, string>;
  network?: { name: string; sha256: string; near: number; far: number };
  layers: { views: number; height: number; width: number; degree: number }[];
  channels: { name: string; bytes: number[] }[][];
  count?: number;
  degree: number;
  sections: { name: string; offset: number; bytes: number }[];
  /** Prefixes, in bytes, behind which the picture is better than before. */
  steps: number[];
};
