// The newest value from one thread to another: without a lock, and with one.
//
// A triple buffer has three slots. The writer owns one, the reader owns one, the third is in between.
// Each side exchanges its own slot for the one in between, so neither ever waits, and no slot is
// copied while it is written. (A seqlock needs less memory: the reader copies, and repeats if a
// counter says that the writer was busy meanwhile. But reading what another thread writes is a data
// race, so undefined in C++, even if the copy is then thrown away. The payload has to consist of
// atomic words, with fences around them; and the reader may repeat without a bound. H.-J. Boehm, Can
// seqlocks get along with programming language memory models?, 2012.)
#pragma once

#include <pthread.h>

#include <array>
#include <atomic>
#include <mutex>
#include <stdexcept>
#include <utility>

template <typename T>
class TripleBuffer {  // one writer, one reader
public:
  void write(const T& value) {
    slots_[writers_] = value;
    // Release: the contents are visible before the index. Acquire: the reader is done with the slot.
    writers_ = between_.exchange(writers_ | kNew, std::memory_order_acq_rel) & kIndex;
  }
  bool read(T& value) {  // whether it is newer than that of the last call
    const bool fresh = between_.load(std::memory_order_relaxed) & kNew;
    if (fresh) readers_ = between_.exchange(readers_, std::memory_order_acq_rel) & kIndex;
    value = slots_[readers_];
    return fresh;
  }

private:
  static constexpr unsigned kNew = 4, kIndex = 3;
  std::array<T, 3> slots_{};
  // Cache lines of their own: else each write would take the reader's line away.
  alignas(64) std::atomic<unsigned> between_{1};
  alignas(64) unsigned writers_ = 0;
  alignas(64) unsigned readers_ = 2;
};

template <typename T, typename Mutex = std::mutex>
class MutexBuffer {
public:
  void write(const T& value) {
    const std::lock_guard<Mutex> lock(mutex_);
    value_ = value;
    fresh_ = true;
  }
  bool read(T& value) {
    const std::lock_guard<Mutex> lock(mutex_);
    value = value_;
    return std::exchange(fresh_, false);
  }

private:
  Mutex mutex_;
  T value_{};
  bool fresh_ = false;
};

// Its holder runs at the priority of the most urgent thread that waits for it (POSIX).
class InheritingMutex {
public:
  InheritingMutex() {
    pthread_mutexattr_t attributes;
    pthread_mutexattr_init(&attributes);
    const bool denied = pthread_mutexattr_setprotocol(&attributes, PTHREAD_PRIO_INHERIT) != 0 ||
                        pthread_mutex_init(&mutex_, &attributes) != 0;
    pthread_mutexattr_destroy(&attributes);
    if (denied) throw std::runtime_error("this system has no mutex with priority inheritance");
  }
  InheritingMutex(const InheritingMutex&) = delete;
  InheritingMutex& operator=(const InheritingMutex&) = delete;
  ~InheritingMutex() { pthread_mutex_destroy(&mutex_); }
  void lock() { pthread_mutex_lock(&mutex_); }
  void unlock() { pthread_mutex_unlock(&mutex_); }

private:
  pthread_mutex_t mutex_;
};
