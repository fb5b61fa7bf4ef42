"""Training of `edge`: data with exact depth and real photos, losses, and a loop that can be stopped and resumed.

python -m tinysplat.training CONFIG.toml --out DIR [--minutes N] [--resume]
"""
