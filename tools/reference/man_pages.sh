#!/bin/sh
# man_pages.sh BIN FOLDER: a manual page of each program and of each command of tendril, from --help (help2man). Called by
# the build.
set -e
bin=$1 folder=$2
rm -rf "$folder"
mkdir -p "$folder"
version=$("$bin/tendril" --version | cut -d' ' -f2)
"$bin/tendril-reference" --commands | while read -r command; do
  name=$(echo "$command" | tr ' ' '-')
  # shellcheck disable=SC2086  # one word a command
  summary=$("$bin"/$command --help | head -n 1)
  help2man --no-info --section=1 --name="$summary" --version-string="$version" --output="$folder/$name.1" "$bin/$command" </dev/null
done
