/*
 * Fuzzing of a node's receiver: datagrams of any length and content, each in memory of its own size, so that the address
 * sanitizer sees one byte read beyond it. Half are random; half are good ones with bytes changed, of these half with the CRC
 * made right again, so that what lies behind it is reached too.
 *
 *     fuzz [datagrams [seed]]          0 datagrams: until it is stopped
 *
 * Prints how often each verdict was given. Exit status 1 if a datagram is taken that is no message of this design, or if one is
 * unpacked and packed again to other bytes.
 */
#include "arm1_node.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static uint64_t state;

/* xorshift64*, Vigna 2016 */
static uint32_t draw(uint32_t below)
{
    state ^= state >> 12;
    state ^= state << 25;
    state ^= state >> 27;
    return (uint32_t)((state * 2685821657736338717u) >> 32) % below;
}

static uint32_t good(uint8_t *bytes, uint32_t instant)
{
    arms_message_t message = {{ARMS_DESIGN_0, ARMS_DESIGN_1}, 2u, instant, instant, {0.5f, -0.25f}};

    if (draw(8u) == 0u) message.sender = draw(65536u);
    if (draw(8u) == 0u) message.number = draw(UINT32_MAX);
    if (draw(8u) == 0u) message.instant = instant + draw(40u) - 20u;
    arms_pack(&message, bytes);
    return ARMS_MESSAGE_BYTES;
}

static void mend(uint8_t *bytes, uint32_t length)
{
    const uint32_t crc = arms_crc32(bytes, length - 4u);

    for (uint32_t k = 0u; k < 4u; k++) bytes[length - 4u + k] = (uint8_t)(crc >> (8u * k));
}

int main(int argc, char **argv)
{
    const uint64_t datagrams = (argc > 1) ? strtoull(argv[1], NULL, 10) : 100000u;
    static arm1_node_t node;
    static uint64_t verdicts[ARMS_REFUSALS + 1u];
    uint32_t instant = 0u;

    state = (argc > 2) ? strtoull(argv[2], NULL, 10) * 2u + 1u : 1u;
    if (arm1_node_init(&node) != ARM1_OK) return 2;
    for (uint64_t n = 0u; (datagrams == 0u) || (n < datagrams); n++) {
        uint8_t whole[256];
        uint32_t length = draw(sizeof(whole));

        if (draw(2u) == 0u) {
            for (uint32_t k = 0u; k < length; k++) whole[k] = (uint8_t)draw(256u);
            if (draw(2u) == 0u) length = ARMS_MESSAGE_BYTES;
        } else {
            length = good(whole, instant);
            for (uint32_t k = draw(4u); k > 0u; k--) whole[draw(length)] = (uint8_t)draw(256u);
            if (draw(2u) == 0u) mend(whole, length);
        }
        uint8_t *exact = malloc(length > 0u ? length : 1u);
        if (exact == NULL) return 2;
        memcpy(exact, whole, length);
        const arms_verdict_t verdict = arm1_receive(&node, exact, length);
        arms_message_t message;
        if ((verdict == ARMS_TAKEN) && (arms_unpack(&message, exact, length) != ARMS_TAKEN)) return 1;
        if (arms_unpack(&message, exact, length) == ARMS_TAKEN) {
            uint8_t again[ARMS_MESSAGE_BYTES];
            arms_pack(&message, again);
            if (memcmp(again, exact, length) != 0) return 1;
        }
        free(exact);
        verdicts[verdict]++;
        if (draw(4u) == 0u) {
            const float y[2] = {(float)draw(100u), -(float)draw(100u)};
            float u[1];
            uint8_t bytes[ARMS_MESSAGE_BYTES];

            instant++;
            (void)arm1_send(&node, instant, y, bytes);
            (void)arm1_node_step(&node, instant, y, u);
            if (draw(1000u) == 0u) arm1_forget(&node, draw(3u));
            if (draw(1000u) == 0u) arm1_node_reset(&node);
        }
    }
    for (uint32_t k = 0u; k <= ARMS_REFUSALS; k++) printf("%" PRIu64 " ", verdicts[k]);
    for (uint32_t k = 5u; k < ARMS_REFUSALS; k++) printf("%" PRIu32 " ", node.refused[k]);
    printf("\n");
    return 0;
}
