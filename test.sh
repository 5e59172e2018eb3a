#!/usr/bin/env bash
# Runs every test of the project, after installing what they need. The one command for people and CI.
set -euo pipefail
cd "$(dirname "$0")"
step() { printf '\n== %s\n' "$1"; }
fail() { printf '\nFAILED: %s\n' "$1" >&2; exit 1; }
trap 'printf "\nFAILED: see above\n" >&2' ERR
target=${CARGO_TARGET_DIR:-target}

step "Tools"
command -v cargo >/dev/null || fail "cargo is missing: install Rust from https://rustup.rs"
command -v python3 >/dev/null || fail "python3 is missing: install it (apt-get install python3 python3-venv)"
if [ ! -x .venv/bin/pip ]; then
  rm -rf .venv
  python3 -m venv .venv || fail "python3 cannot make a virtual environment: install its venv module (apt-get install python3-venv)"
fi
.venv/bin/pip install --quiet --disable-pip-version-check -r tests/crosscheck/requirements.txt \
  -r training/requirements.txt ||
  fail "pip cannot install the Python checkers: is the network there?"

# for the feature gdal, and for slopes and warps against GDAL's programs
has_gdal() { command -v gdaldem >/dev/null && command -v gdalwarp >/dev/null && pkg-config --exists gdal 2>/dev/null; }
# for the kernels: Vulkan in software, which every machine can have
has_vulkan() {
  compgen -G '/usr/share/vulkan/icd.d/lvp_icd*.json' >/dev/null && [ -n "$(ldconfig -p 2>/dev/null | grep 'libvulkan\.so\.1')" ]
}
# for tiles in a browser
has_chromium() { command -v chromium >/dev/null || command -v chromium-browser >/dev/null; }
packages=()
has_gdal || packages+=(gdal-bin libgdal-dev pkg-config)
has_vulkan || packages+=(mesa-vulkan-drivers libvulkan1)
has_chromium || packages+=(chromium)
if [ ${#packages[@]} -gt 0 ] && command -v apt-get >/dev/null && [ "$(id -u)" = 0 ]; then
  apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "${packages[@]}" >/dev/null ||
    echo "apt-get cannot install ${packages[*]}"
fi
skipped=""
has_gdal || skipped="$skipped (checks against GDAL's programs skipped: install gdal-bin, libgdal-dev and pkg-config)"
has_chromium || skipped="$skipped (checks of 3D Tiles in a browser skipped: install chromium)"
if has_vulkan; then
  export REQUIRE_GPU=1
else
  skipped="$skipped (tests of GPU kernels skipped: install mesa-vulkan-drivers and libvulkan1)"
fi

# for files of 3D programs: the validator of glTF, and other readers of it and of 3D Tiles
if command -v npm >/dev/null; then
  npm ci --prefix tests/crosscheck/node --silent --no-audit --no-fund ||
    fail "npm cannot install the checkers of glTF: is the network there?"
else
  skipped="$skipped (checks of glTF and 3D Tiles by other readers skipped: install node and npm)"
fi

step "Format"
cargo fmt --check

step "Clippy, warnings are errors"
cargo clippy --all-targets --quiet -- -D warnings

step "Docs, warnings are errors"
RUSTDOCFLAGS="-D warnings" cargo doc --no-deps --document-private-items --quiet

step "Rust tests"
cargo test --quiet

step "Rust tests without the feature gpu"
cargo clippy --quiet --no-default-features -- -D warnings
cargo test --quiet --no-default-features --lib gpu::

if has_gdal; then
  step "Rust tests of the feature gdal"
  cargo test --quiet --features gdal --lib gdal
fi

step "Python cross-checks"
# quick to link; the program's own settings only make it some percent faster
CARGO_PROFILE_RELEASE_LTO=false cargo build --release --quiet --bins --example run_network
[ -x "$target/release/wildwood" ] || fail "no program at $target/release/wildwood"
.venv/bin/python -m pytest -q -rs --disable-warnings -p no:cacheprovider tests/crosscheck

step "All tests passed$skipped"
