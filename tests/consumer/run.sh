#!/bin/sh
# run.sh BUILD_DIR
# Installs a finished build to a temporary prefix, then builds and runs the programs
# of this directory against it twice: with find_package(granopt) and with pkg-config.
# Exits with 0 if both ways give the same right results.
set -eu

here=$(cd "$(dirname "$0")" && pwd)
build=$(cd "${1:?usage: run.sh BUILD_DIR}" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

say() { echo "== $*"; }
fail() {
  echo "consumer: $*" >&2
  exit 1
}
# The value of a variable in the cache of the build.
cached() { sed -n "s/^$1:[^=]*=//p" "$build/CMakeCache.txt"; }

compiler=$(cached CMAKE_CXX_COMPILER)
launcher=$(command -v ccache || true)
# A static library built with sanitizers needs them in the program, too.
flags=$(cached CMAKE_CXX_FLAGS)
link_flags=$(cached CMAKE_EXE_LINKER_FLAGS)

# Runs the program $1 and checks what it prints; leaves that in $1.out.
check() {
  say "$1"
  "$1" >"$1.out" || { cat "$1.out"; fail "$1 exits with $?"; }
  sed 's/^/   /' "$1.out"
  for expected in "$2" "$3"; do
    grep -Eq "$expected" "$1.out" || fail "$1 does not print '$expected'"
  done
}
check_both() {
  check "$1/minimize" '^CONVERGED: \|g\| = ' '^x = 1\.000000 1\.000000$'
  check "$1/search" '^[1-9][0-9]* strings$' '^x = 0\.5 3\.0$'
  check "$1/pack" '^CONVERGED$' '^energy = [1-9]\.[0-9]*e-0[4-7] from '
}

say "install to $work/first"
cmake --install "$build" --prefix "$work/first" >"$work/install.log" ||
  { cat "$work/install.log"; fail "cmake --install failed"; }
# Whatever was written down there, it must not be the place.
mv "$work/first" "$work/prefix"
say "moved to $work/prefix"
(cd "$work/prefix" && find . -type f | LC_ALL=C sort | sed 's/^/   /')
# Nor may the package lead back to the sources.
if grep -rl -e "$work/first" -e "$build" "$work/prefix" --include='*.cmake' \
    --include='*.pc'; then
  fail "installed files name the build directory"
fi

say "build with find_package(granopt)"
{
  cmake -G Ninja -S "$here" -B "$work/cmake" \
    -DCMAKE_PREFIX_PATH="$work/prefix" \
    -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_FLAGS_RELEASE=-O1 \
    -DCMAKE_CXX_COMPILER="$compiler" \
    -DCMAKE_CXX_COMPILER_LAUNCHER="$launcher" \
    -DCMAKE_CXX_FLAGS="$flags" -DCMAKE_EXE_LINKER_FLAGS="$link_flags" &&
    cmake --build "$work/cmake" --parallel 2
} >"$work/cmake.log" 2>&1 || { cat "$work/cmake.log"; fail "build failed"; }
check_both "$work/cmake"

pc=$(dirname "$(find "$work/prefix" -name granopt-solvers.pc)")
lib=$(dirname "$pc")
export PKG_CONFIG_PATH="$pc${PKG_CONFIG_PATH:+:$PKG_CONFIG_PATH}"
# Where the libraries are shared.
export LD_LIBRARY_PATH="$lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"
mkdir "$work/pkgconfig"
# compile PROGRAM PACKAGE [--static]
compile() {
  # shellcheck disable=SC2086  # may be empty
  arguments=$(pkg-config ${3-} --cflags --libs "$2") || fail "pkg-config $2"
  say "c++ $1.cc \$(pkg-config ${3-} --cflags --libs $2)"
  echo "   $arguments"
  # shellcheck disable=SC2086  # lists of flags
  "$compiler" -std=c++17 -O1 -Wall -Wextra -Werror $flags "$here/$1.cc" \
    -o "$work/pkgconfig/$1" $arguments $link_flags
}
for static in "" --static; do
  compile minimize granopt-solvers $static
  compile search granopt-searches $static
  compile pack granopt-granular $static
  check_both "$work/pkgconfig"
done
[ "$(pkg-config --modversion granopt-solvers)" = "$(cached CMAKE_PROJECT_VERSION)" ] ||
  fail "pkg-config has another version than the project"

say "the two ways agree"
for program in minimize search pack; do
  diff "$work/cmake/$program.out" "$work/pkgconfig/$program.out" ||
    fail "$program prints something else"
done

if [ -f "$lib/libgranopt_granular.a" ]; then
  say "the packages name every library that is needed"
  # shellcheck disable=SC2046,SC2086
  "$compiler" -std=c++17 $flags -x c++ - -x none -o "$work/all" \
    -Wl,--whole-archive "$lib/libgranopt_granular.a" "$lib/libgranopt_searches.a" \
    "$lib/libgranopt_solvers.a" -Wl,--no-whole-archive \
    $(pkg-config --libs granopt-granular granopt-searches) $link_flags <<EOF
int main() { return 0; }
EOF
fi

say "every installed header compiles"
include=$work/prefix/include/granopt
(cd "$include" && find . -name '*.h' | LC_ALL=C sort |
  sed 's|^\./\(.*\)|#include "\1"|') >"$work/headers.cc"
# shellcheck disable=SC2046,SC2086
"$compiler" -std=c++17 -fsyntax-only $flags $(pkg-config --cflags granopt-granular) \
  "$work/headers.cc"
say "consumer: all is well"
