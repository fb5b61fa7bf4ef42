#!/bin/bash
# checks/processor.py on aarch64 without one: an arm64 Python of Debian and the arm64 wheels under qemu-user (Debian, as
# root; about ten minutes of one core). On a Raspberry Pi run checks/processor.py itself. Seconds mean nothing here.
# onnxruntime 1.20, older than the project allows: newer wheels end with a segmentation fault under qemu 7.2.
set -euo pipefail
repository=$(cd "$(dirname "$0")/.." && pwd)
work=$(mktemp -d)
dpkg --add-architecture arm64
trap 'dpkg --remove-architecture arm64; rm -rf "$work"' EXIT
apt-get update -q && apt-get install -y -q qemu-user-static
cd "$work"
packages="python3.11-minimal libpython3.11-minimal libpython3.11-stdlib libc6 libstdc++6 libgcc-s1 zlib1g libexpat1 libffi8
 libbz2-1.0 liblzma5 libssl3 libuuid1 libcrypt1 libsqlite3-0"
for package in $packages; do apt-get download -q "$package:arm64"; done
for package in *.deb; do dpkg -x "$package" root; done
python3 -m pip download -q --no-deps --only-binary=:all: --python-version 3.11 --platform manylinux_2_28_aarch64 \
    --platform manylinux_2_27_aarch64 -d wheels numpy onnxruntime==1.20.1 "av<19"
for wheel in wheels/*.whl; do python3 -m zipfile -e "$wheel" site; done
PYTHONPATH=$work/site PYTHONDONTWRITEBYTECODE=1 OMP_NUM_THREADS=1 \
    qemu-aarch64-static -cpu cortex-a72 -L root root/usr/bin/python3.11 "$repository/checks/processor.py" --repeat 1
