#!/usr/bin/env bash
# Runs every test of the project, after installing what they need. The one command for people and CI.
set -euo pipefail
cd "$(dirname "$0")"
step() { printf '\n== %s\n' "$1"; }

step "Python checkers"
[ -d .venv ] || python3 -m venv .venv
.venv/bin/pip install --quiet --disable-pip-version-check -r tests/crosscheck/requirements.txt

step "GDAL, for the feature gdal and the slope cross-check"
if ! command -v gdaldem >/dev/null || ! pkg-config --exists gdal; then
  if command -v apt-get >/dev/null && [ "$(id -u)" = 0 ]; then
    apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq gdal-bin libgdal-dev pkg-config clang >/dev/null
  else
    echo "skipped: install gdal-bin and libgdal-dev to run these checks"
  fi
fi

step "Format"
cargo fmt --check

step "Clippy, warnings are errors"
cargo clippy --all-targets --quiet -- -D warnings

step "Docs, warnings are errors"
RUSTDOCFLAGS="-D warnings" cargo doc --no-deps --document-private-items --quiet

step "Rust tests"
cargo test --quiet

if pkg-config --exists gdal 2>/dev/null; then
  step "Rust tests of the feature gdal"
  cargo test --quiet --features gdal --lib gdal
fi

step "Python cross-checks"
cargo build --release --quiet
.venv/bin/python -m pytest -q -p no:cacheprovider tests/crosscheck
