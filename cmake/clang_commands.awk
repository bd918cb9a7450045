# Prints compile_commands.json for clang: without the precompiled headers and the parameters of gcc, and
# with an entry for each of the files that are compiled as one (UNITY_BUILD).

function replaced(text, old, new,   at, done) {
  while ((at = index(text, old)) > 0) {
    done = done substr(text, 1, at - 1) new
    text = substr(text, at + length(old))
  }
  return done text
}

function print_entry(source,   i) {
  printf "%s{\n", separator
  for (i = 1; i <= count; ++i) print source == "" ? line[i] : replaced(line[i], file, source)
  printf "}"
  separator = ",\n"
}

BEGIN { print "[" }
/^{/ { count = 0 }
/^  "/ {
  gsub(/ -Winvalid-pch -include [^ ]*cmake_pch[.]hxx/, "")
  gsub(/ --param=[^ ]*/, "")
  line[++count] = $0
  if ($1 == "\"file\":") {
    file = $0
    sub(/^  "file": "/, "", file)
    sub(/",?$/, "", file)
  }
}
/^}/ {
  if (file !~ /[/]Unity[/]unity_[0-9]+_cxx[.]cxx$/) {
    print_entry("")
  } else {
    while ((getline included < file) > 0) {
      if (sub(/^#include "/, "", included) && sub(/"$/, "", included)) print_entry(included)
    }
    close(file)
  }
}
END { print "\n]" }
