"""The paper's evaluation data in the layout that MVSplat and DepthSplat publish: RealEstate10K, ACID, DL3DV.

    folder = ChunkFolder("re10k/test", SPECS["re10k"])
    windows = read_paper_index("evaluation_index_re10k.json", "re10k")
    images, cameras = folder.scene(key).views(windows[key].context, (256, 256))

Chunks are loaded with torch, `weights_only`; frames are prepared as the official evaluations do.
"""

from .chunks import ChunkFolder, ChunkScene
from .indices import SPECS, DatasetSpec, Window, read_paper_index

__all__ = ["SPECS", "ChunkFolder", "ChunkScene", "DatasetSpec", "Window", "read_paper_index"]
