// SPDX-License-Identifier: Apache-2.0
#include "estimation/worker_team.hpp"

#include <stdexcept>
#include <string>

namespace pilotage {

WorkerTeam::WorkerTeam(int workers) {
  if (workers < 1) {
    throw std::invalid_argument("threads must be at least 1, got " + std::to_string(workers));
  }
  for (int w = 1; w < workers; ++w) threads_.emplace_back([this, w] { serve(w); });
}

WorkerTeam::~WorkerTeam() {
  {
    const std::lock_guard lock(mutex_);
    is_ending_ = true;
  }
  begun_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void WorkerTeam::take_tasks(const Task& task, int count, int worker) {
  for (int i = next_++; i < count; i = next_++) task(i, worker);
}

void WorkerTeam::run(int count, const Task& task) {
  next_ = 0;
  if (threads_.empty() || count < 2) {
    take_tasks(task, count, 0);
    return;
  }
  {
    const std::lock_guard lock(mutex_);
    task_ = &task;
    count_ = count;
    busy_ = static_cast<int>(threads_.size());
    ++round_;
  }
  begun_.notify_all();
  take_tasks(task, count, 0);
  std::unique_lock lock(mutex_);
  done_.wait(lock, [this] { return busy_ == 0; });
}

void WorkerTeam::serve(int worker) {
  long served = 0;
  std::unique_lock lock(mutex_);
  while (true) {
    begun_.wait(lock, [&] { return is_ending_ || round_ != served; });
    if (is_ending_) return;
    served = round_;
    lock.unlock();
    take_tasks(*task_, count_, worker);
    lock.lock();
    if (--busy_ == 0) done_.notify_one();
  }
}

}  // namespace pilotage
