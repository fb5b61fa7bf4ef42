"""ONNX graphs that a user may name with `--model`: a small network that keeps the contract, and damage to its parts.

Byte damage to a protobuf mostly ends in its parser. Here the message is taken apart, so that what onnxruntime and the
contract's checks see is a graph: with other operators, wires, shapes, types, weights and metadata.
"""

from functools import lru_cache
from random import Random

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from .damage import damage

_OPERATORS = (
    "Relu", "Abs", "Neg", "Exp", "Log", "Sqrt", "Reciprocal", "Identity", "Shape", "Size", "NonZero", "Not", "Cast",
    "Add", "Div", "Pow", "MatMul", "Mod", "Concat", "Squeeze", "Unsqueeze", "Transpose", "Flatten", "Softmax", "If",
    "Loop", "Scan", "SequenceConstruct", "StringNormalizer", "RandomNormalLike", "TopK", "Gather", "NoSuchOperator",
)  # fmt: skip

_SIDES = (0, 1, 2, 7, -1, 2**16, 2**31, 2**62)

_METADATA = (
    "", "{", "[]", "null", '{"contract": 2}', '{"contract": "1"}', '{"contract": null}', '{"min_views": 0}',
    '{"max_views": 1}', '{"stride": 1000000}', '{"stride": 4.5}', '{"min_side": 100000000}', '{"stride": true}',
    "[" * 100_000, '{"min_views": "\ud83d"}', '{"max_views": 1e999}', '{"stride": ' + "9" * 5000 + "}",
)  # fmt: skip


@lru_cache(maxsize=1)
def network_seeds() -> tuple[bytes, ...]:
    """A network of one layer and one of two, that turn photos into Gaussians of no great beauty."""
    return _network(layers=1), _network(layers=2)


def _network(layers: int) -> bytes:
    nodes = [
        helper.make_node("Transpose", ["images"], ["pixels"], perm=[0, 2, 3, 1]),
        helper.make_node("Add", ["pixels", "bias"], ["means"]),
        helper.make_node("Mul", ["means", "small"], ["scales"]),
        helper.make_node("ReduceMean", ["images"], ["opacities"], axes=[1], keepdims=0),
        helper.make_node("Unsqueeze", ["opacities", "last"], ["w"]),
        helper.make_node("Concat", ["w", "pixels"], ["quats"], axis=3),
        helper.make_node("Unsqueeze", ["pixels", "fourth"], ["sh"]),
    ]
    ranks = {"means": 4, "quats": 4, "scales": 4, "opacities": 3, "sh": 5}
    outputs = dict(ranks)
    if layers > 1:
        for name, rank in (*ranks.items(), ("K", 3)):
            nodes.append(helper.make_node("Identity", [name if name != "K" else "K_pixels"], [f"layer1_{name}"]))
            outputs[f"layer1_{name}"] = rank
        nodes.insert(0, helper.make_node("Mul", ["K", "sides"], ["K_pixels"]))
    constants = {
        "bias": np.float32([0, 0, 2]),
        "small": np.float32([0.01]),
        "last": np.int64([3]),
        "fourth": np.int64([3]),
        "sides": np.float32([[8], [8], [1]]),
    }
    inputs = {"images": 4, "K": 3, "c2w": 3, "near": 1, "far": 1}
    graph = helper.make_graph(
        nodes,
        "network",
        [_tensor(name, rank) for name, rank in inputs.items()],
        [_tensor(name, rank) for name, rank in outputs.items()],
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, {"tinysplat": '{"contract": 1, "min_views": 2, "stride": 4}'})
    onnx.checker.check_model(model)
    return model.SerializeToString()


def _tensor(name: str, rank: int) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, [None] * rank)


def damage_network(data: bytes, rng: Random) -> bytes:
    """A network with one to three of its parts changed; sometimes plain damage."""
    if rng.random() < 0.15:
        return damage(data, rng)
    model = onnx.load_from_string(data)
    for _ in range(rng.choice((1, 1, 2, 3))):
        rng.choice((_rewire, _rewire, _change_operator, _change_attribute, _change_weights, _change_interface, _label))(
            model, rng
        )
    return model.SerializeToString()


def _rewire(model: onnx.ModelProto, rng: Random) -> None:
    nodes = model.graph.node
    node, other = rng.choice(nodes), rng.choice(nodes)
    match rng.randrange(4):
        case 0:
            nodes.remove(node)
        case 1:
            nodes.append(other)
        case 2 if node.input and other.output:
            node.input[rng.randrange(len(node.input))] = rng.choice((other.output[0], "images", "K", "near", "", "?"))
        case _ if node.output:
            node.output[0] = rng.choice((other.output[0] if other.output else "", "K", "spare"))


def _change_operator(model: onnx.ModelProto, rng: Random) -> None:
    node = rng.choice(model.graph.node)
    node.op_type = rng.choice(_OPERATORS)
    if rng.random() < 0.2:
        node.domain = rng.choice(("ai.onnx.ml", "com.microsoft", "tinysplat"))


def _change_attribute(model: onnx.ModelProto, rng: Random) -> None:
    node = rng.choice([n for n in model.graph.node if n.attribute] or model.graph.node)
    if not node.attribute or rng.random() < 0.2:
        node.attribute.append(helper.make_attribute(rng.choice(("axis", "axes", "to", "perm")), rng.choice(_SIDES)))
        return
    attribute = rng.choice(node.attribute)
    attribute.i = rng.choice(_SIDES)
    if attribute.ints:
        attribute.ints[rng.randrange(len(attribute.ints))] = rng.choice(_SIDES)


def _change_weights(model: onnx.ModelProto, rng: Random) -> None:
    tensor = rng.choice(model.graph.initializer)
    match rng.randrange(5):
        case 0:
            tensor.raw_data = damage(tensor.raw_data, rng) if tensor.raw_data else b"\0"
        case 1:
            tensor.dims[:] = [rng.choice(_SIDES) for _ in range(rng.choice((0, 1, 2, 9)))]
        case 2:
            tensor.data_type = rng.choice((0, 1, 6, 7, 8, 10, 16, 99))
        case 3:
            tensor.CopyFrom(numpy_helper.from_array(_odd_values(rng), tensor.name))
        case _:
            tensor.data_location = TensorProto.EXTERNAL
            tensor.external_data.add(key="location", value=rng.choice(("../x", "/etc/passwd", "f.data", "", "f.onnx")))
            tensor.external_data.add(key="length", value=rng.choice(("-1", "12", "99999999999", "x")))


def _odd_values(rng: Random) -> NDArray:
    value = rng.choice((np.nan, np.inf, -np.inf, 3e38, -1.0, 0.0, 1e-45))
    return np.full(rng.choice(((), (1,), (3,), (2, 1, 1, 1), (0,))), value, np.float32)


def _change_interface(model: onnx.ModelProto, rng: Random) -> None:
    tensor = rng.choice((*model.graph.input, *model.graph.output))
    kind = tensor.type.tensor_type
    match rng.randrange(5):
        case 0:
            kind.elem_type = rng.choice((0, 1, 4, 7, 8, 9, 10, 11, 99))
        case 1 if kind.shape.dim:
            rng.choice(kind.shape.dim).dim_value = rng.choice(_SIDES)
        case 2:
            tensor.name = rng.choice(("images", "layer1_means", "layer7_means", "", "x" * 2000, "a\nb"))
        case 3:
            spare = rng.choice((*model.graph.output, *model.graph.input))
            rng.choice((model.graph.output, model.graph.input)).append(spare)
        case _:
            of = model.graph.output if tensor in model.graph.output else model.graph.input
            of.remove(tensor)


def _label(model: onnx.ModelProto, rng: Random) -> None:
    match rng.randrange(3):
        case 0:
            model.opset_import[0].version = rng.choice((0, 1, 7, 13, 22, 1000, -1))
        case 1:
            model.ir_version = rng.choice((0, 3, 10, 99, 2**31))
        case _:
            value = rng.choice(_METADATA)
            model.metadata_props[0].value = value.encode("utf-8", "surrogatepass").decode("utf-8", "replace")
