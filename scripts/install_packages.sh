# Sourced: install Debian packages, after asking where that takes another user's rights.

# Whether `sudo` may be used for the packages $*: YES=1 says so, else a terminal is asked.
agreed() {
    [ "${YES:-}" = 1 ] && return 0
    [ -t 0 ] && [ -t 2 ] || return 1
    printf 'setup: install %s with sudo? [y/N] ' "$*" >&2
    read -r answer
    [ "$answer" = y ] || [ "$answer" = Y ]
}

install_packages() {
    command -v apt-get >/dev/null || return 1
    as_root='env DEBIAN_FRONTEND=noninteractive'
    if [ "$(id -u)" != 0 ]; then
        command -v sudo >/dev/null && agreed "$@" || return 1
        sudo -n true 2>/dev/null || [ -t 0 ] || return 1
        as_root="sudo $as_root"
    fi
    echo "setup: installing $*"
    patience="-o Acquire::http::Timeout=30 -o Acquire::https::Timeout=30 -o Acquire::Retries=1"
    log=$(mktemp)
    { $as_root apt-get $patience update; $as_root apt-get $patience install -y --no-install-recommends "$@"; } >"$log" 2>&1 </dev/null ||
        { tail -n 5 "$log" >&2; rm -f "$log"; return 1; }
    rm -f "$log"
}
