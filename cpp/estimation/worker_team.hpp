// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace pilotage {

/// Threads that share numbered tasks. Tasks are handed out in ascending order, so one that waits
/// for its predecessors never waits for a task not begun.
class WorkerTeam {
 public:
  using Task = std::function<void(int index, int worker)>;

  /// The caller of `run` is one of the `workers`. Throws std::invalid_argument below 1.
  explicit WorkerTeam(int workers);
  ~WorkerTeam();
  WorkerTeam(const WorkerTeam&) = delete;
  WorkerTeam& operator=(const WorkerTeam&) = delete;

  int workers() const { return static_cast<int>(threads_.size()) + 1; }
  /// Calls task(index, worker) for index 0 to count - 1 and returns when all are done. Tasks must
  /// not throw.
  void run(int count, const Task& task);

 private:
  void serve(int worker);
  void take_tasks(const Task& task, int count, int worker);

  std::vector<std::thread> threads_;
  std::mutex mutex_;
  std::condition_variable begun_, done_;
  const Task* task_ = nullptr;
  int count_ = 0;
  int busy_ = 0;
  long round_ = 0;
  bool is_ending_ = false;
  std::atomic<int> next_{0};
};

}  // namespace pilotage
