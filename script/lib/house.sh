# shellcheck shell=bash
# What every command in script/ shares: where the checkout is, how to speak, how to show help.
# Sourced, not run. Messages go to stderr: stdout belongs to what the command was asked for.

ROOT=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd -P)
VENV=$ROOT/.venv
PATH=${PATH//"$VENV/bin:"/} # activated or not, .venv is never what .venv is made from
# pip's own settings (index, certificates, PIP_*) are the user's and are never touched here.

say() { printf '%s\n' "$*" >&2; }

# die STATUS MESSAGE... : one line for each message, then exit. 2: wrong usage, 3: the machine lacks something.
die() {
  local status=$1
  shift
  printf '%s\n' "$@" >&2
  exit "$status"
}

# The help of a command is the comment at its top: it cannot drift from what a reader of the file sees.
help_of() { sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$1"; }

# Milliseconds since some moment. EPOCHREALTIME has a comma in some locales, so only digits count.
now_ms() {
  local digits=${EPOCHREALTIME//[!0-9]/}
  echo "$((digits / 1000))"
}

# 12345 -> 12.3, without depending on the locale.
seconds() { printf '%d.%d' "$(($1 / 1000))" "$(($1 % 1000 / 100))"; }

# Files of the tree that match a pattern, NUL-separated: tree_files '*.cpp' 'script/*'
tree_files() { "$VENV/bin/python" "$ROOT/script/lib/tree_rules.py" "$ROOT" --list "$@"; }

# shellcheck source=script/lib/system.sh
source "$ROOT/script/lib/system.sh"
# shellcheck source=script/lib/venv.sh
source "$ROOT/script/lib/venv.sh"
