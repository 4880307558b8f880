# Sourced: install Debian packages where that needs no question.

install_packages() {
    as_root='env DEBIAN_FRONTEND=noninteractive'
    if [ "$(id -u)" != 0 ]; then
        sudo -n true 2>/dev/null || return 1
        as_root="sudo -n $as_root"
    fi
    command -v apt-get >/dev/null || return 1
    echo "setup: installing $*"
    log=$(mktemp)
    { $as_root apt-get update; $as_root apt-get install -y --no-install-recommends "$@"; } >"$log" 2>&1 </dev/null ||
        { tail -n 5 "$log" >&2; rm -f "$log"; return 1; }
    rm -f "$log"
}
