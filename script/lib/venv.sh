# shellcheck shell=bash
# The virtual environment .venv, with octobrick installed editable. Sourced by house.sh.
#
# Edits of Python and GLSL need no reinstall. Two stamps inside .venv say what it was made from:
# dependencies (pyproject.toml, the Python, the place) and native code (C++ and CMake files). Where
# both still hold nothing is asked of pip, so nothing is ever upgraded behind your back.

# Makes .venv, or brings it up to date. Needs ensure_system_packages first. $VENV/bin/python works after it.
ensure_venv() {
  local dependencies native lock
  mkdir -p "$ROOT/build"
  # Two commands at once must not build into one place; flock is missing on few systems only.
  exec {lock}>"$ROOT/build/.venv.lock"
  ! command -v flock >/dev/null || flock "$lock"

  venv_is_usable || make_venv
  dependencies=$(dependencies_digest)
  native=$(native_digest)
  if ! stamp_holds dependencies "$dependencies" || ! is_installed; then
    install_all
    write_stamp dependencies "$dependencies"
    write_stamp native "$native"
  elif ! stamp_holds native "$native"; then
    say "Native code has changed: building it"
    install_package --no-deps
    write_stamp native "$native"
  fi
  exec {lock}>&-
}

# Packages of an extra in pyproject.toml, on first use and when the list has changed.
ensure_extra() {
  local extra=$1 requirements digest
  mapfile -t requirements < <(list_requirements "$extra")
  digest=$(printf '%s\n' "${requirements[@]}" | sha256sum)
  stamp_holds "extra-$extra" "$digest" && return
  say "Installing the $extra extra: ${requirements[*]}"
  pip_install "${requirements[@]}"
  write_stamp "extra-$extra" "$digest"
}

# A .venv that came along from another place (a copied folder, a container's mount) has that place in
# its scripts; one whose Python is gone or was replaced by another version has no packages any more.
venv_is_usable() {
  [[ -x $VENV/bin/python ]] || return 1
  grep -qF "$VENV" "$VENV/bin/activate" 2>/dev/null || return 1
  "$VENV/bin/python" - "$(wanted_version)" <<'PY' 2>/dev/null
import sys
import sysconfig
from pathlib import Path

import pip  # noqa: F401  made without pip, we could install nothing

version = "%d.%d" % sys.version_info[:2]
packages_are_ours = Path(sysconfig.get_path("purelib")).is_dir()
sys.exit(not (packages_are_ours and sys.argv[1] in ("", version)))
PY
}

# major.minor of $PYTHON, or nothing where the user named none: then any usable .venv is kept.
wanted_version() {
  [[ -z ${PYTHON:-} ]] || "$PYTHON" -c 'import sys; print("%d.%d" % sys.version_info[:2])'
}

make_venv() {
  local python
  python=$(find_python)
  [[ ! -e $VENV ]] || say "Replacing $VENV, which was made for another place or another Python"
  rm -rf "$VENV"
  say "Creating $VENV with $("$python" -V)"
  "$python" -m venv "$VENV"
}

install_all() {
  local -a build
  say "Installing dependencies and building octobrick (a minute or two, once)"
  # Without build isolation a rebuild compiles what changed instead of everything, but then what
  # builds must be there first.
  mapfile -t build < <(list_requirements build)
  pip_install "${build[@]}"
  install_package
}

install_package() {
  PATH=$VENV/bin:$PATH pip_install --no-build-isolation "$@" --editable "${ROOT}[dev]"
}

pip_install() { "$VENV/bin/python" -m pip install --quiet --disable-pip-version-check "$@" >&2; }

# list_requirements EXTRA|build : from pyproject.toml, the one place that lists them.
list_requirements() {
  "$VENV/bin/python" - "$ROOT/pyproject.toml" "$1" <<'PY'
import sys
import tomllib

path, extra = sys.argv[1:]
with open(path, "rb") as file:
    project = tomllib.load(file)
extras = project["project"]["optional-dependencies"]
if extra == "build":
    # scikit-build-core asks for CMake and Ninja by itself only under build isolation.
    tools = [line for line in extras["dev"] if line.startswith(("cmake", "ninja"))]
    print(*project["build-system"]["requires"], *tools, sep="\n")
else:
    print(*extras[extra], sep="\n")
PY
}

dependencies_digest() {
  {
    echo "$ROOT"
    "$VENV/bin/python" -c 'import sys; print(sys.version, sys.base_prefix)'
    cat "$ROOT/pyproject.toml"
  } | sha256sum
}

native_digest() {
  (
    cd "$ROOT" || exit
    find CMakeLists.txt codec store renderer measure server -type f \
      \( -name CMakeLists.txt -o -name '*.cmake' -o -name '*.cpp' -o -name '*.h' \) -print0 |
      LC_ALL=C sort -z | xargs -0 sha256sum
  ) | sha256sum
}

is_installed() { compgen -G "$VENV/lib/python*/site-packages/octobrick-*.dist-info" >/dev/null; }

stamp_holds() { [[ -f $VENV/octobrick-$1.stamp && $(<"$VENV/octobrick-$1.stamp") == "$2" ]]; }

write_stamp() { printf '%s\n' "$2" >"$VENV/octobrick-$1.stamp"; }
