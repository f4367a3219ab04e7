# shellcheck shell=bash
# System packages: what pip cannot bring. Sourced by house.sh.
#
# Needs are probed, not looked up in a package database: a compiler that a conda or Nix user brought
# counts, and the same probes work on every distribution. Only the remedy knows package names.

PYTHON_MINIMUM=3.11

# The interpreter to build .venv with: $PYTHON where set, else the first in PATH that is new enough.
find_python() {
  local candidate
  for candidate in ${PYTHON:-python3 python3.14 python3.13 python3.12 python3.11}; do
    if command -v "$candidate" >/dev/null && python_is_new_enough "$candidate"; then
      command -v "$candidate"
      return
    fi
  done
  return 1
}

python_is_new_enough() {
  "$1" -c "import sys; sys.exit(sys.version_info < (${PYTHON_MINIMUM/./, }))" 2>/dev/null
}

# One word a line for each thing that the machine lacks. Quick: one Python start and one ldconfig.
missing_needs() {
  local python libraries
  command -v "${CXX:-c++}" >/dev/null || echo compiler
  if python=$(find_python); then
    "$python" - <<'PY'
import importlib.util
import pathlib
import sysconfig

# Debian ships venv without ensurepip until python3-venv is installed.
if not all(importlib.util.find_spec(name) for name in ("venv", "ensurepip")):
    print("venv")
if not pathlib.Path(sysconfig.get_path("include"), "Python.h").exists():
    print("headers")
PY
  else
    printf '%s\n' python venv headers
  fi
  libraries=$(PATH=$PATH:/sbin:/usr/sbin ldconfig -p 2>/dev/null || true)
  [[ $libraries == *libEGL.so.1* ]] || echo egl
  [[ $libraries == *libGL.so.1* ]] || echo gl
  # Debian's pip trusts the system's certificates, and git does not bring them.
  if command -v apt-get >/dev/null && [[ ! -e /etc/ssl/certs/ca-certificates.crt ]]; then
    echo certificates
  fi
}

# The name of a need in words, for systems whose package names we do not know.
describe_need() {
  case $1 in
    compiler) echo "a C++20 compiler as c++ or \$CXX (gcc 12, clang 15 or newer)" ;;
    python) echo "Python $PYTHON_MINIMUM or newer as python3 or \$PYTHON" ;;
    venv) echo "that Python's venv and ensurepip modules" ;;
    headers) echo "that Python's C headers (Python.h)" ;;
    egl) echo "libEGL.so.1 with a driver, e.g. Mesa (to render without a screen)" ;;
    gl) echo "libGL.so.1 (to render without a screen)" ;;
    certificates) echo "CA certificates" ;;
  esac
}

# The Debian and Ubuntu package for a need. The names are the same from Debian 12 and Ubuntu 24.04 on.
package_for() {
  local python
  case $1 in
    compiler) echo g++ ;;
    python) echo python3 ;;
    venv | headers)
      # python3-venv serves the distribution's default Python only; another one has its own packages.
      python=python3
      [[ -z ${PYTHON:-} ]] || python=$("$PYTHON" -c 'import sys; print("python%d.%d" % sys.version_info[:2])')
      [[ $1 == venv ]] && echo "$python-venv" || echo "$python-dev"
      ;;
    egl) echo libegl1 ;;
    gl) echo libgl1 ;;
    certificates) echo ca-certificates ;;
  esac
}

# Makes sure that what pip cannot bring is there. Silent where nothing is missing; installs where it
# may (root, or sudo that asks no password); else says what is missing and how to get it, status 3.
ensure_system_packages() {
  ensure_needs
  offer_openvdb
}

ensure_needs() {
  local -a needs packages=()
  local need
  refuse_old_python
  mapfile -t needs < <(missing_needs)
  ((${#needs[@]})) || return 0
  if ! command -v apt-get >/dev/null; then
    explain_needs "${needs[@]}"
    return 0
  fi
  for need in "${needs[@]}"; do packages+=("$(package_for "$need")"); done
  install_packages "${packages[@]}"

  mapfile -t needs < <(missing_needs)
  ((${#needs[@]} == 0)) || die 3 "Installed ${packages[*]}, and yet the machine lacks:" \
    "$(for need in "${needs[@]}"; do echo "  $(describe_need "$need")"; done)" \
    "Where several Pythons are in PATH, name the one to use: PYTHON=/usr/bin/python3 $0"
}

# OpenVDB is optional: without it octobrick builds, and says so where a .vdb is opened. So it is
# installed where that takes no question, and nothing stops where it does not work.
offer_openvdb() {
  local refused=$ROOT/build/no-openvdb
  if has_openvdb || [[ -e $refused ]] || ! command -v apt-get >/dev/null || ! may_install; then
    return 0
  fi
  # In a subshell, because a failure ends it.
  if ! (install_packages libopenvdb-dev libboost-iostreams-dev); then
    mkdir -p "${refused%/*}"
    touch "$refused"
    say "Going on without OpenVDB: .vdb files will not be read. (rm $refused to try again.)"
  fi
}

# Whether the compiler finds OpenVDB's headers, and the part of Boost that they want.
has_openvdb() {
  "${CXX:-c++}" -x c++ -E - >/dev/null 2>&1 <<'CPP'
#if !__has_include(<openvdb/openvdb.h>) || !__has_include(<boost/iostreams/stream.hpp>)
#error
#endif
CPP
}

# A machine whose Python is too old is told so, before anything is installed on it.
refuse_old_python() {
  local python=${PYTHON:-python3}
  find_python >/dev/null && return
  if command -v "$python" >/dev/null; then
    die 3 "$("$python" -V) at $(command -v "$python") is too old: octobrick needs $PYTHON_MINIMUM or newer." \
      "Debian 12 and Ubuntu 24.04 have it. Elsewhere install one and name it: PYTHON=python3.12 $0"
  elif [[ -n ${PYTHON:-} ]]; then
    die 3 "PYTHON names $PYTHON, which is not there. Unset it, or name a Python $PYTHON_MINIMUM or newer."
  fi
}

is_root() { ((EUID == 0)); }

may_install() { is_root || sudo -n true 2>/dev/null; }

install_packages() {
  local -a become=() apt
  local log=$ROOT/build/system-packages.log
  if ! is_root; then
    if ! sudo -n true 2>/dev/null; then
      die 3 "These packages are missing: $*" "Install them, then run $0 again:" "" \
        "  sudo apt-get update && sudo apt-get install --no-install-recommends $*" ""
    fi
    become=(sudo -n)
  fi
  apt=("${become[@]}" env DEBIAN_FRONTEND=noninteractive
    apt-get -q -o Acquire::Retries=3 -o DPkg::Lock::Timeout=120 -o Dpkg::Use-Pty=0)
  say "Installing system packages: $*"
  mkdir -p "${log%/*}"
  # A mirror that is down for one list need not matter for these packages: the install decides.
  "${apt[@]}" update >"$log" 2>&1 || say "apt-get update failed; going on with the lists that are there."
  if ! "${apt[@]}" install -y --no-install-recommends "$@" </dev/null >>"$log" 2>&1; then
    tail -n 30 "$log" >&2
    die 3 "apt-get could not install: $*" "The end of its messages is above, all of them are in $log"
  fi
}

# Not Debian: say what is needed, stop only without what nothing works without.
explain_needs() {
  local need system=this
  # shellcheck source=/dev/null
  [[ ! -r /etc/os-release ]] || system=$(source /etc/os-release && echo "${PRETTY_NAME:-this}")
  say "octobrick installs its system packages on Debian and Ubuntu. On $system please provide:"
  for need in "$@"; do say "  $(describe_need "$need")"; done
  case " $* " in
    *" compiler "* | *" python "* | *" venv "* | *" headers "*) exit 3 ;;
  esac
  say "Going on without; what needs it will say so."
}
