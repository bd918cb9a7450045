# The environment of tests that are built with sanitizers. Sourced by scripts/test after
# gsv_use_build.
#
#   gsv_sanitizers LIST       exports the sanitizers' options; their reports go to files
#   gsv_no_report             fails after showing the reports, when there are any
#
# Programs of ours are linked with the runtime. One that is not loads our libraries: `nodelet`, which
# needs the runtime preloaded, and it alone (bash breaks off under libtsan). A script of its name in
# the build's folder, where roslaunch and rosrun look first, does that.

gsv_sanitizers() {
  gsv_reports=$gsv_build_folder/reports
  rm -rf "$gsv_reports"
  mkdir -p "$gsv_reports" "$gsv_space/lib/nodelet"
  local log=log_path=$gsv_reports/report suppressions=$gsv_root/test/sanitizers library=libasan.so
  [[ $1 != thread ]] || library=libtsan.so
  [[ $1 != undefined ]] || library=libubsan.so
  # Leaks are looked for in programs of our own, the unit tests: what Python and the manager of the
  # rostests keep until they end is not ours.
  export ASAN_OPTIONS=$log:detect_leaks=1:detect_stack_use_after_return=1:new_delete_type_mismatch=1
  export LSAN_OPTIONS=$log:suppressions=$suppressions/leaks.supp:print_suppressions=0
  # How many times as long a test may take as its time limit says.
  export GROUND_SCALE_VO_SLOWER=10
  # Beside gcc's address, undefined does not know log_path: its report goes to stderr, so the program
  # must end with it.
  export UBSAN_OPTIONS=$log:print_stacktrace=1:halt_on_error=1
  export TSAN_OPTIONS=$log:suppressions=$suppressions/thread.supp:exitcode=0

  local program
  for program in /opt/ros/"${ROS_DISTRO:-noetic}"/lib/nodelet/nodelet /usr/lib/nodelet/nodelet; do
    [[ ! -x $program ]] || break
  done
  # A loader (`nodelet load`) has no code of ours in it.
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
