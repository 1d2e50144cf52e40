// Two threads share a trajectory through one of the buffers of newest_value.hpp.
//   check METHOD COUNT: write so many values; 0 if none is torn, none is older than the one before,
//     and the last one arrives
//   latency METHOD SCENARIO SECONDS CORE CORE: how long each call takes; for reader and writer: calls,
//     and the times below which half, 99 %, 99.9 % and all of them lie [ns]; then 1 if the reader
//     ran under SCHED_FIFO
// Scenarios: "alone"; "loaded", two busy threads on each core; "preempted", one busy thread beside
// the writer on its core, none beside the reader.
#include <pthread.h>
#include <sched.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "newest_value.hpp"

struct Trajectory {  // fifty points of seven joints: positions and velocities
  long count = 0;
  std::array<double, 700> parts{};
};

template <typename T>
struct NotShared {  // a copy of the same size, that no other thread touches: what both cost anyway
  T writers{}, readers{};
  void write(const T& value) { writers = value; }
  bool read(T& value) {
    value = readers;
    return false;
  }
};

template <typename Buffer>
int check(long count) {
  const auto buffer = std::make_unique<Buffer>();
  Trajectory value;
  if (buffer->read(value)) return 1;  // nothing was written yet
  std::thread writer([&] {
    Trajectory next;
    for (long n = 1; n <= count; ++n) {
      next.count = n;
      next.parts.fill(static_cast<double>(n));
      buffer->write(next);
    }
  });
  int fault = 0;
  long last = 0, fresh = 0;
  while (last < count && fault == 0) {
    const bool now = buffer->read(value);
    const auto whole = static_cast<double>(value.count);
    if (value.count < last || now != (value.count > last)) fault = 2;
    if (std::any_of(value.parts.begin(), value.parts.end(), [&](double x) { return x != whole; }))
      fault = 3;
    fresh += now;
    last = value.count;
  }
  writer.join();
  if (fault != 0) return fault;
  if (buffer->read(value) || value.count != count) return 4;  // the newest stays, and is not new
  std::printf("%ld\n", fresh);
  return 0;
}

using Clock = std::chrono::steady_clock;

static void pin(int core) {
  cpu_set_t cores;
  CPU_ZERO(&cores);
  CPU_SET(static_cast<unsigned>(core), &cores);
  pthread_setaffinity_np(pthread_self(), sizeof cores, &cores);
}

static void report(std::vector<long>& taken) {
  if (taken.empty()) taken.push_back(0);
  std::sort(taken.begin(), taken.end());
  std::printf("%zu", taken.size());
  for (double share : {0.5, 0.99, 0.999, 1.0}) {
    const auto last = static_cast<double>(taken.size() - 1);
    std::printf(" %ld", taken[static_cast<std::size_t>(share * last)]);
  }
  std::printf("\n");
}

// Call again and again until the end; record how long each call took, without allocating.
template <typename Call>
std::vector<long> record(Clock::time_point start, Clock::time_point end, Clock::duration pause,
                         Call call) {
  std::vector<long> taken(4'000'000);  // touched here, so that no page is missing later
  std::this_thread::sleep_until(start);
  std::size_t n = 0;
  for (auto begin = Clock::now(); begin < end && n < taken.size(); begin = Clock::now()) {
    call();
    const auto after = Clock::now();
    taken[n++] = std::chrono::duration_cast<std::chrono::nanoseconds>(after - begin).count();
    if (pause.count() > 0) std::this_thread::sleep_until(after + pause);
  }
  taken.resize(n);
  return taken;
}

// Otherwise the compiler may drop a copy that nobody looks at.
static void use(const Trajectory& value) { asm volatile("" : : "r"(&value) : "memory"); }

template <typename Buffer>
int latency(const std::string& scenario, double seconds, int writers_core, int readers_core) {
  const auto buffer = std::make_unique<Buffer>();
  const auto begin = Clock::now() + std::chrono::milliseconds(100);
  const auto end =
      begin + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  std::vector<std::thread> busy;
  for (int core : {writers_core, readers_core}) {
    int many = scenario == "loaded" ? 2 : 0;
    if (scenario == "preempted" && core == writers_core) many = 1;
    for (int i = 0; i < many; ++i)
      busy.emplace_back([=] {
        pin(core);
        for (volatile long n = 0; Clock::now() < end;) n = n + 1;
      });
  }
  std::vector<long> read, written;
  int fifo = 0;
  std::thread writer([&] {  // always writing: most likely to be interrupted with the lock
    pin(writers_core);
    Trajectory value;
    written = record(begin, end, Clock::duration::zero(), [&] {
      value.count += 1;
      use(value);
      buffer->write(value);
      use(value);
    });
  });
  std::thread reader([&] {  // a control loop of 2 kHz, urgent if the system allows it
    pin(readers_core);
    const sched_param priority{60};
    fifo = pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority) == 0 ? 1 : 0;
    Trajectory value;
    read = record(begin, end, std::chrono::microseconds(500), [&] {
      buffer->read(value);
      use(value);
    });
  });
  writer.join();
  reader.join();
  for (auto& thread : busy) thread.join();
  report(read);
  report(written);
  std::printf("%d\n", fifo);
  return 0;
}

template <typename Buffer>
int run(int count, char** words) {
  if (std::string(words[1]) == "check") return check<Buffer>(std::atol(words[3]));
  if (count != 7) return 64;
  return latency<Buffer>(words[3], std::atof(words[4]), std::atoi(words[5]), std::atoi(words[6]));
}

int main(int count, char** words) {
  if (count < 4) return 64;
  const std::string method = words[2];
  if (method == "triple") return run<TripleBuffer<Trajectory>>(count, words);
  if (method == "mutex") return run<MutexBuffer<Trajectory>>(count, words);
  if (method == "inherit") return run<MutexBuffer<Trajectory, InheritingMutex>>(count, words);
  if (method == "none" && count == 7) return run<NotShared<Trajectory>>(count, words);
  return 64;
}
