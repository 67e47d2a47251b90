#!/bin/bash
# Installs those Debian packages of apt-packages.txt that are missing: the required
# and the optional ones. Packages that are installed already, in whatever version,
# are left alone.
#
#   third_party_notes/install.sh [--required-only | --all]
#
#   --required-only   what granopt cannot be built without
#   --all             the heavy ones, too: peers that only comparisons need
#
# Exit status: 0 everything is installed; 2 bad usage, or no right to install
# (the command to run is printed); else that of apt-get.
set -euo pipefail

list="$(dirname -- "${BASH_SOURCE[0]}")/apt-packages.txt"
usage="usage: install.sh [--required-only | --all]"
sections=""

for argument in "$@"; do
  case "${argument}" in
    --required-only | --all)
      wanted="required"
      [[ "${argument}" == --all ]] && wanted="required optional heavy"
      if [[ -n "${sections}" && "${sections}" != "${wanted}" ]]; then
        echo "install.sh: --required-only and --all exclude each other" >&2
        exit 2
      fi
      sections="${wanted}"
      ;;
    -h | --help)
      echo "${usage}"
      exit 0
      ;;
    *)
      echo "install.sh: unknown argument '${argument}' (${usage})" >&2
      exit 2
      ;;
  esac
done
sections="${sections:-required optional}"

# Prints the packages of the list, one a line. See there for the syntax.
list_packages() {
  awk -v sections="${sections}" '
    $1 == "#" && $2 ~ /^(required|optional|heavy):?$/ {
      section = $2
      sub(/:$/, "", section)
      next
    }
    { sub(/#.*/, "") }
    NF == 0 { next }
    section == "" || NF > 1 {
      printf "%s:%d: not a package in a section: %s\n", FILENAME, FNR, $0 \
        > "/dev/stderr"
      exit 2
    }
    index(sections, section) { print $1 }
  ' "${list}"
}

# Of "install ok installed" the first word is what was asked for ("hold" for a
# held package); the other two say what is.
is_installed() {
  [[ "$(dpkg-query -W -f='${Status}\n' "$1" 2> /dev/null || true)" \
    == *" ok installed"* ]]
}

packages="$(list_packages)"
missing=()
for package in ${packages}; do
  is_installed "${package}" || missing+=("${package}")
done

if ((${#missing[@]} == 0)); then
  echo "install.sh: nothing to install"
  exit 0
fi

as_root=()
if ((EUID != 0)); then
  if ! command -v sudo > /dev/null; then
    echo "install.sh: not root and no sudo; as root, run:" \
      "apt-get update && apt-get install -y --no-install-recommends" \
      "${missing[*]}" >&2
    exit 2
  fi
  as_root=(sudo)
fi

log="$(mktemp)"
trap 'rm -f "${log}"' EXIT

# Runs apt-get; what it says is shown only if it fails.
apt_get() {
  local status=0
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
    apt-get -q -o DPkg::Lock::Timeout=120 "$@" > "${log}" 2>&1 || status=$?
  if ((status != 0)); then
    echo
    cat "${log}" >&2
    echo "install.sh: 'apt-get $1' failed with status ${status}" >&2
    exit "${status}"
  fi
}

SECONDS=0
echo -n "install.sh: installing ${missing[*]} ..."
apt_get update
apt_get install -y --no-install-recommends "${missing[@]}"
echo " done in ${SECONDS} s"
