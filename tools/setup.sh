#!/bin/sh
# Make the virtual environment with the pinned packages, or add optional packages to it.
#
#   sh tools/setup.sh                        make it, bring it up to date, or report that it is
#   sh tools/setup.sh add EXTRA DESCRIPTION  add an extra of pyproject.toml, once
#
# The Makefile calls this script with its variables in the environment. CHOSEN is empty unless
# somebody chose PYTHON; GOAL is the target that make was called with.
set -eu

BIN=$VENV/bin
# Complete but for the check of the system's libraries: when that fails, the next run repeats the
# check and not the installation.
UNCHECKED=$VENV/unchecked

elapsed() { # the time since $1, in words
    seconds=$(($(date +%s) - $1))
    if [ "$seconds" -lt 60 ]; then
        echo "$seconds s"
    else
        echo "$((seconds / 60)) min $((seconds % 60)) s"
    fi
}

fail() { # $1 is the step
    echo "$1 failed: the last lines are above, all of it is in $LOG" >&2
    exit 1
}

fail_with_log() {
    tail -n 12 "$LOG" >&2
    fail "$1"
}

version_of() {
    "$1" -c 'import sys; print("%d.%d.%d" % sys.version_info[:3])' 2>/dev/null
}

# Install an extra. In a terminal pip shows its own progress; elsewhere its output goes to the log.
install() {
    start=$(date +%s)
    if [ -t 1 ]; then
        status=0
        "$BIN/python" -m pip install --log "$LOG.full" -c constraints.txt -e ".[$1]" || status=$?
        # pip logs every file that an index offers: 30 MB that say nothing about what was installed.
        grep -v -e ' Found link ' -e ' Skipping link: ' "$LOG.full" >>"$LOG" || :
        rm -f "$LOG.full"
        [ "$status" -eq 0 ] || fail installing
    else
        "$BIN/python" -m pip install -c constraints.txt -e ".[$1]" >>"$LOG" 2>&1 ||
            fail_with_log installing
    fi
    count=$(sed -n 's/.*Successfully installed //p' "$LOG" | tail -n 1 | wc -w)
    noun=packages
    [ "$count" -ne 1 ] || noun=package
    echo "installed $((count)) $noun in $(elapsed "$start")"
}

# Stop if PYTHON can't make the environment. What is there stays as it is.
require_python() {
    hint="The course needs Python 3.11 to 3.13; name one with: make PYTHON=python3.13 $GOAL"
    if ! command -v "$PYTHON" >/dev/null; then
        echo "'$PYTHON' was not found. $hint" >&2
        exit 1
    fi
    if ! "$PYTHON" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))'; then
        echo "'$PYTHON' is $("$PYTHON" --version 2>&1). $hint" >&2
        exit 1
    fi
    if ! "$PYTHON" -c 'import venv, ensurepip' 2>/dev/null; then
        echo "'$PYTHON' has no venv module. On Debian and Ubuntu: apt install python3-venv" >&2
        exit 1
    fi
}

set_up() {
    # What an installation was made for: where a line differs, it is not the one that is needed.
    # A virtual environment holds absolute paths, so a moved tree needs a new one.
    place=$(pwd -P)/$VENV
    fingerprint=$(cat pyproject.toml constraints.txt | cksum)
    had_place= had_python= had_fingerprint=
    for stamp in "$UNCHECKED" "$STAMP"; do
        [ ! -f "$stamp" ] || {
            read -r had_place && read -r had_python && read -r had_fingerprint
        } <"$stamp" || had_fingerprint=
    done
    here=$(version_of "$BIN/python") || here=none
    requested=$here
    [ -z "$CHOSEN" ] || requested=$(version_of "$PYTHON") || requested=missing

    why=
    if [ ! -d "$VENV" ]; then why="there is none yet"
    elif [ -z "$had_fingerprint" ]; then why="the last install did not finish"
    elif [ "$had_place" != "$place" ]; then why="the one here was made in $had_place"
    elif [ "$had_python" != "$here" ]; then why="its Python was $had_python and is now $here"
    elif [ "$requested" != "$here" ]; then why="it has Python $here and $PYTHON is $requested"
    elif [ "$had_fingerprint" = "$fingerprint" ] && [ -f "$STAMP" ]; then
        echo "$VENV is up to date (Python $here)"
        exit 0
    fi

    begun=$(date +%s)
    if [ -n "$why" ]; then
        require_python
        echo "making $VENV: $why"
        echo "about $PACKAGES packages: about $DOWNLOAD to download, $DISK on disk" \
            "(several GB more where the package index gives PyTorch with CUDA)"
        rm -rf "$VENV"
        "$PYTHON" -m venv "$VENV" >"$LOG" 2>&1 || fail_with_log "making $VENV"
        echo "made $VENV in $(elapsed "$begun")"
    elif [ "$had_fingerprint" != "$fingerprint" ]; then
        echo "updating $VENV: pyproject.toml or constraints.txt has changed"
        rm -f "$STAMP" "$UNCHECKED"
    else
        echo "checking $VENV again: the packages are there, a library of the system was missing"
    fi
    : >"$LOG"
    if [ ! -f "$UNCHECKED" ]; then
        echo "installing the packages pinned in constraints.txt; $LOG has the details"
        install "$EXTRAS"
        # Importing rfc3987-syntax takes seconds in every process that reads a notebook.
        "$BIN/python" -m pip uninstall -q -y rfc3987-syntax lark >>"$LOG" 2>&1 ||
            fail_with_log uninstalling
    fi
    start=$(date +%s)
    "$BIN/python" -c 'import course, jsonschema, nbformat' >>"$LOG" 2>&1 ||
        fail_with_log "importing the packages"
    { echo "$place"; version_of "$BIN/python"; echo "$fingerprint"; } >"$UNCHECKED"
    "$BIN/python" -m tools.libraries || {
        echo "$VENV is not ready" >&2
        exit 1
    }
    echo "checked the packages in $(elapsed "$start")"
    mv "$UNCHECKED" "$STAMP"
    echo "$VENV is ready after $(elapsed "$begun")"
}

# The stamp holds the pins and the Python that the extra was installed for. It is inside of the
# environment, so whatever makes a new one removes it.
add() {
    stamp=$STAMP-$1
    fingerprint="$(sed -n 3p "$STAMP") $(sed -n 2p "$STAMP")"
    [ "$(cat "$stamp" 2>/dev/null)" != "$fingerprint" ] || exit 0
    rm -f "$stamp"
    echo "adding $2 to $VENV; $LOG has the details"
    install "$1"
    echo "$fingerprint" >"$stamp"
}

mkdir -p "$(dirname "$LOG")"
case ${1-} in
    add) add "$2" "$3" ;;
    *) set_up ;;
esac
