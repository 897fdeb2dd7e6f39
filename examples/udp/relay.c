/* A network that loses, delays, repeats, reorders and corrupts: every message goes through this process. */
#include "node.h"

#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

enum { ROOM = 256, LONGEST = 64 };
/* (39): 1 listens to 2, 2 to 3, 3 to 1 */
static const unsigned LISTENER[AGENTS] = {2, 0, 1};

typedef struct {
    uint32_t due;
    unsigned listener;
    size_t length;
    uint8_t bytes[LONGEST];
} letter_t;

static letter_t letters[ROOM];
static unsigned waiting;

/* A number below a bound: the same on every machine (a 32-bit linear congruence, its high bits). */
static uint32_t draw(uint32_t *seed, uint32_t below)
{
    *seed = *seed * 1664525u + 1013904223u;
    return (*seed >> 8) % below;
}

static int chance(uint32_t *seed, double probability)
{
    return draw(seed, 1u << 24) < probability * (1u << 24);
}

static void take(const uint8_t *bytes, size_t length, uint32_t instant, const network_t *network, uint32_t *seed)
{
    const unsigned sender = (unsigned)bytes[2] + 256u * bytes[3]; /* from 1: see the header of the messages */
    const int copies = 1 + chance(seed, network->twice);

    if (length < 4 || length > LONGEST || sender < 1 || sender > AGENTS || chance(seed, network->loss)) return;
    for (int k = 0; k < copies && waiting < ROOM; k++) {
        letter_t *letter = &letters[waiting++];

        letter->due = instant + draw(seed, network->late + 1u);
        letter->listener = LISTENER[sender - 1];
        letter->length = length;
        memcpy(letter->bytes, bytes, length);
        if (chance(seed, network->corrupt)) letter->bytes[draw(seed, (uint32_t)length)] ^= (uint8_t)(1u << draw(seed, 8u));
    }
}

int relay_run(int socket, const struct sockaddr_in agents[AGENTS], int from_world, int to_world, const network_t *network)
{
    uint32_t seed = network->seed * 2654435761u + 7u;
    tick_t tick;

    while (read_all(from_world, &tick, sizeof tick)) {
        const answer_t answer = {0};
        uint8_t bytes[LONGEST];
        ssize_t length;

        while ((length = recv(socket, bytes, sizeof bytes, MSG_DONTWAIT)) >= 0) {
            take(bytes, (size_t)length, tick.instant, network, &seed);
        }
        for (unsigned k = 0; k < waiting;) { /* the last one first where one leaves: another disorder */
            if ((int32_t)(tick.instant - letters[k].due) < 0) {
                k++;
            } else {
                const struct sockaddr_in *to = &agents[letters[k].listener];

                (void)sendto(socket, letters[k].bytes, letters[k].length, 0, (const struct sockaddr *)to, sizeof *to);
                letters[k] = letters[--waiting];
            }
        }
        if (!write_all(to_world, &answer, sizeof answer)) return 2;
    }
    return 0;
}
