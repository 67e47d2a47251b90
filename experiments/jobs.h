// granopt: many runs of a binary as processes of their own.

#ifndef GRANOPT_EXPERIMENTS_JOBS_H_
#define GRANOPT_EXPERIMENTS_JOBS_H_

#include <functional>
#include <string>
#include <vector>

namespace granopt {

// A child process: the file `program` with `arguments`, no shell. What it
// prints to stdout and stderr goes to `log`, stdin is empty.
struct Job {
  std::string name;  // "n64_seed3", for messages
  std::string program;
  std::vector<std::string> arguments;  // from the program's own name on
  std::string log;
  double weight = 1.0;  // of its duration, for estimates
};

// The program of jobs that are copies of this process: the very file that it
// runs, replaced by a build or not.
extern const char kThisProgram[];

struct JobOutcome {
  enum State { NOT_STARTED, EXITED, KILLED, FAILED_TO_START };
  State state = NOT_STARTED;
  int status = 0;  // the exit status, the signal, or errno
  double seconds = 0.0;
};

// "exit status 2", "killed by signal 9", "not started", "cannot be started: No
// such file or directory".
std::string Describe(const JobOutcome& outcome);

struct JobProgress {
  int done = 0, running = 0, total = 0;
  double seconds = 0.0;  // since the first start
  // Of what is left, by weight from those done; 0 if none is.
  double seconds_left = 0.0;
  bool interrupted = false;
};

// Runs all jobs, at most `at_once` at a time, in order; outcome k is that of
// job k. Jobs share nothing, so that no result depends on `at_once`, and one
// that fails stops no other.
//
// SIGINT or SIGTERM to this process is passed to the children, which are in
// process groups of their own so that they get it once whether it comes from a
// terminal or from kill; no further job is started, and the call returns once
// the running ones have ended as they see fit. A second signal is passed on
// too. Should this process be killed, its children get SIGTERM. `observer` (may
// be empty) is called about five times a second, and with every end.
std::vector<JobOutcome> RunJobs(
    const std::vector<Job>& jobs,
    int at_once,
    const std::function<void(const JobProgress&)>& observer,
    bool* interrupted);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_JOBS_H_
