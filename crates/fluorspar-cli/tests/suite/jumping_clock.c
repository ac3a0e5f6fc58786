/* A clock of the day that jumps by thirty years at every look, for LD_PRELOAD. Other clocks go on as they are. */
#define _GNU_SOURCE
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

int clock_gettime(clockid_t clock, struct timespec *time)
{
    static long looks;
    int answer = (int)syscall(SYS_clock_gettime, clock, time);
    if (answer == 0 && clock == CLOCK_REALTIME) {
        time->tv_sec += __sync_fetch_and_add(&looks, 1) % 2 ? 1000000000 : -1000000000;
    }
    return answer;
}
