#!/usr/bin/env bash
# Fuzzes each parser for the given seconds (default 600), from the committed seeds: no panic, no hang over
# 20 s, no allocation over 512 MiB. Needs `cargo install cargo-fuzz`; works with a stable toolchain.
set -euo pipefail
cd "$(dirname "$0")/.."
seconds=${1:-600}
shift || true
targets=("$@")
[ ${#targets[@]} -gt 0 ] || targets=(geotiff ascii_grid elv las biome_toml vector schedule scene_toml parquet)
export RUSTC_BOOTSTRAP=1
for target in "${targets[@]}"; do
  mkdir -p "fuzz/corpus/$target"
  # the laz crate's own debug assertions trip on damaged bits, which release builds take in their stride
  mode=--debug-assertions
  [ "$target" = las ] && mode=--release
  cargo fuzz run "$mode" "$target" "fuzz/corpus/$target" "fuzz/seeds/$target" -- \
    -max_total_time="$seconds" -malloc_limit_mb=512 -rss_limit_mb=2048 -timeout=20 -print_final_stats=1 -verbosity=0
done
