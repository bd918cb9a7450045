# Environment of the tests built with sanitizers. Sourced by scripts/test after gsv_use_build.
#
#   gsv_sanitizers LIST       exports the sanitizers' options; the reports go to files
#   gsv_no_report             fails and prints the reports, if there are any
#
# The executables of this package are linked with the sanitizer runtime. `nodelet` is not, but loads
# its libraries, so the runtime must be preloaded for `nodelet` only (bash aborts under libtsan). A
# wrapper named nodelet in the build folder, where roslaunch and rosrun look first, does this.

gsv_sanitizers() {
  gsv_reports=$gsv_build_folder/reports
  rm -rf "$gsv_reports"
  mkdir -p "$gsv_reports" "$gsv_space/lib/nodelet"
  local log=log_path=$gsv_reports/report suppressions=$gsv_root/test/sanitizers library=libasan.so
  [[ $1 != thread ]] || library=libtsan.so
  [[ $1 != undefined ]] || library=libubsan.so
  # scripts/test switches leak detection off for the rostests.
  # abort_on_error: a fuzz target names the input under test when it gets the signal.
  export ASAN_OPTIONS=$log:detect_leaks=1:detect_stack_use_after_return=1:new_delete_type_mismatch=1
  ASAN_OPTIONS+=:abort_on_error=1
  export LSAN_OPTIONS=$log:suppressions=$suppressions/leaks.supp:print_suppressions=0
  # Factor on the time limits of the tests, which run several times slower with sanitizers.
  export GROUND_SCALE_VO_SLOWER=10
  # Combined with gcc's address sanitizer, the undefined behaviour sanitizer ignores log_path and
  # reports to stderr. halt_on_error makes the program fail, otherwise nobody would see the report.
  export UBSAN_OPTIONS=$log:print_stacktrace=1:halt_on_error=1:abort_on_error=1
  export TSAN_OPTIONS=$log:suppressions=$suppressions/thread.supp:exitcode=0

  local program
  for program in "$(gsv_distribution)"/lib/nodelet/nodelet /usr/lib/nodelet/nodelet; do
    [[ ! -x $program ]] || break
  done
  # A loader (`nodelet load`) contains no code of this package.
  cat >"$gsv_space/lib/nodelet/nodelet" <<END
#!/bin/sh
case \$1 in manager | standalone) export LD_PRELOAD=$(realpath "$(gcc -print-file-name="$library")") ;; esac
exec $program "\$@"
END
  chmod +x "$gsv_space/lib/nodelet/nodelet"
}

gsv_no_report() {
  local report status=0
  for report in "$gsv_reports"/*; do
    [[ -f $report ]] || continue
    head -n 40 "$report"
    status=1
  done
  return "$status"
}
