/* Parts of a horizon in threads: lgmpc.compile.pipeline. The caller computes the first part. Threads are started once,
   wait for a moment in a loop, then asleep. A caller that finds them busy computes all parts itself. */

#include <pthread.h>

#define EXPORT __attribute__((visibility("default")))
enum { MOST = 64, SPINS = 20000 };

typedef int Call(void** frame);

static struct { Call* call; void** frame; int result; } tasks[MOST];
static pthread_mutex_t caller = PTHREAD_MUTEX_INITIALIZER, sleepers = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t wake = PTHREAD_COND_INITIALIZER;
static unsigned long long turn;   /* MOST times the number of calls, plus how many tasks the last one has */
static unsigned long long before; /* the turn that a new thread is not part of */
static long threads, left;

static void pause_briefly(void) {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#endif
}

static void* work(void* place) {
  const long mine = (long) place;
  unsigned long long seen = before;
  for (;;) {
    long spins;
    for (spins = 0; spins < SPINS && __atomic_load_n(&turn, __ATOMIC_ACQUIRE) == seen; ++spins) pause_briefly();
    if (spins == SPINS) {
      pthread_mutex_lock(&sleepers);
      while (__atomic_load_n(&turn, __ATOMIC_ACQUIRE) == seen) pthread_cond_wait(&wake, &sleepers);
      pthread_mutex_unlock(&sleepers);
    }
    seen = __atomic_load_n(&turn, __ATOMIC_ACQUIRE);
    if ((unsigned long long) mine < seen % MOST) {
      tasks[mine].result = tasks[mine].call(tasks[mine].frame);
      __atomic_sub_fetch(&left, 1, __ATOMIC_RELEASE);
    }
  }
  return 0;
}

/* A forked process has no threads but the one that forked. */
static void forget(void) {
  threads = 0;
  pthread_mutex_init(&caller, 0);
  pthread_mutex_init(&sleepers, 0);
  pthread_cond_init(&wake, 0);
}

static int start(long number) {
  static int registered;
  if (!registered) registered = pthread_atfork(0, 0, forget) == 0;
  while (threads < number) {
    pthread_t thread;
    before = turn;
    if (!registered || pthread_create(&thread, 0, work, (void*) (threads + 1))) return 0;
    pthread_detach(thread);
    ++threads;
  }
  return 1;
}

/* team: the number of parts; the function; of each part its argument. */
EXPORT int lgmpc_team(void** team) {
  const long n = *(const long long*) team[0];
  Call* call = (Call*) team[1];
  int status = 0;
  long i;
  if (pthread_mutex_trylock(&caller) == 0) {
    if (start(n - 1)) {
      for (i = 1; i < n; ++i) tasks[i].call = call, tasks[i].frame = (void**) team[2 + i];
      left = n - 1;
      pthread_mutex_lock(&sleepers);
      __atomic_store_n(&turn, (turn / MOST + 1) * MOST + n, __ATOMIC_RELEASE);
      pthread_cond_broadcast(&wake);
      pthread_mutex_unlock(&sleepers);
      status = call((void**) team[2]);
      while (__atomic_load_n(&left, __ATOMIC_ACQUIRE)) pause_briefly();
      for (i = 1; i < n; ++i) status |= tasks[i].result;
      pthread_mutex_unlock(&caller);
      return status;
    }
    pthread_mutex_unlock(&caller);
  }
  for (i = 0; i < n; ++i) status |= call((void**) team[2 + i]);
  return status;
}
