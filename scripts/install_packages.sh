# Sourced: install Debian packages where that needs no question.

install_packages() {
    as_root='env DEBIAN_FRONTEND=noninteractive'
    if [ "$(id -u)" != 0 ]; then
        sudo -n true 2>/dev/null || return 1
        as_root="sudo -n $as_root"
    fi
    command -v apt-get >/dev/null || return 1
    echo "setup: installing $*"
    patience="-o Acquire::http::Timeout=30 -o Acquire::https::Timeout=30 -o Acquire::Retries=1"
    log=$(mktemp)
    { $as_root apt-get $patience update; $as_root apt-get $patience install -y --no-install-recommends "$@"; } >"$log" 2>&1 </dev/null ||
        { tail -n 5 "$log" >&2; rm -f "$log"; return 1; }
    rm -f "$log"
}
